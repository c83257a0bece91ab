//! A pattern as the columns or rows that it lights.

use crate::domain::patterns::Pattern;

/// What a pattern changes along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Along {
    /// Columns differ: vertical stripes.
    Columns,
    /// Rows differ: horizontal stripes.
    Rows,
}

/// What was shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Shown {
    /// The largest code everywhere.
    White,
    /// The smallest code everywhere.
    Black,
    /// Lit and dark columns or rows.
    Stripes {
        /// Which.
        along: Along,
        /// Of each column or row, whether it is lit.
        lit: Vec<bool>,
    },
    /// A pattern of another kind, which tells no place.
    Other,
}

impl Shown {
    /// What a pattern shows. Light below a quarter counts as dark and above three quarters as lit, so that patterns that were
    /// stored with losses are known; anything between is another kind.
    pub fn of(pattern: &Pattern) -> Self {
        let (columns, values) = (pattern.columns, &pattern.values);
        let Some(lit) = values.iter().map(binary).collect::<Option<Vec<bool>>>() else { return Self::Other };
        let of_columns: Vec<bool> = lit.iter().take(columns).copied().collect();
        let of_rows: Vec<bool> = lit.iter().step_by(columns).copied().collect();
        let along_columns = lit.chunks(columns).all(|row| row == of_columns);
        let along_rows = lit.chunks(columns).zip(&of_rows).all(|(row, value)| row.iter().all(|texel| texel == value));
        match (along_columns, along_rows) {
            (true, true) if of_columns.first() == Some(&true) => Self::White,
            (true, true) => Self::Black,
            (true, false) => Self::Stripes { along: Along::Columns, lit: of_columns },
            (false, true) => Self::Stripes { along: Along::Rows, lit: of_rows },
            (false, false) => Self::Other,
        }
    }
}

fn binary(light: &f32) -> Option<bool> {
    match light {
        l if *l < 0.25 => Some(false),
        l if *l > 0.75 => Some(true),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::patterns::{Kind, PatternSet};
    use crate::domain::{Filter, Plane};

    #[test]
    fn patterns_are_known_by_what_they_show() {
        let plane = Plane::new(8, 4).unwrap();
        let codes = PatternSet::new(Kind::GrayCode, plane).unwrap();
        assert_eq!(
            Shown::of(&codes.pattern(0)),
            Shown::Stripes { along: Along::Columns, lit: (0..8).map(|c| c >= 4).collect() }
        );
        let last = codes.pattern(codes.len() - 1);
        assert_eq!(
            Shown::of(&last),
            Shown::Stripes { along: Along::Rows, lit: [0, 1, 1, 0].map(|bit| bit == 0).to_vec() }
        );
        let ramp = PatternSet::new(Kind::Ramp, plane).unwrap();
        let of = |code| Shown::of(&ramp.pattern(code));
        assert_eq!([of(0), of(128), of(255)], [Shown::Black, Shown::Other, Shown::White]);
        let squares = PatternSet::new(Kind::Squares { side: 2, filter: Filter::Box }, plane).unwrap();
        assert_eq!(Shown::of(&squares.pattern(0)), Shown::Other);
    }
}
