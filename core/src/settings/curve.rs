//! Values that change with the frame: keys, and what lies between them.

use std::cmp::Ordering;

use super::table::{Bounds, Value};
use crate::error::Result;

/// What happens from one key to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// A straight line.
    #[default]
    Linear,
    /// A cubic that never overshoots; between two lone keys it is `3 s^2 - 2 s^3`.
    Smooth,
    /// The value stays until the next key.
    Hold,
}

/// Words for [`Between`], in its order.
const WORDS: [&str; 3] = ["linear", "smooth", "hold"];
/// Frames that keys can stand on.
const FRAME: Bounds = Bounds::new(-1e7, 1e7, "");

/// A value at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key<const N: usize> {
    /// Frame; parts of a frame are allowed.
    pub frame: f64,
    /// The value there.
    pub value: [f64; N],
    /// How it goes on.
    pub after: Between,
}

/// `N` numbers that change together. Before the first key the curve has its value, after the last that one's.
///
/// ```
/// use relume_core::settings::animation::{Between, Curve, Key};
/// let key = |frame: f64, value: f64| Key { frame, value: [value], after: Between::Linear };
/// let turn = Curve::new(vec![key(0.0, 0.0), key(24.0, 360.0)]).unwrap();
/// assert_eq!(turn.at(6.0), [90.0]);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Curve<const N: usize> {
    /// At least one, frames growing.
    keys: Vec<Key<N>>,
}

impl<const N: usize> Curve<N> {
    /// The same at all frames.
    pub fn constant(value: [f64; N]) -> Self {
        Self { keys: vec![Key { frame: 0.0, value, after: Between::Hold }] }
    }

    /// From keys; `None` where there is none, or frames do not grow.
    pub fn new(keys: Vec<Key<N>>) -> Option<Self> {
        let grow = keys.windows(2).all(|pair| pair[0].frame < pair[1].frame);
        (grow && !keys.is_empty()).then_some(Self { keys })
    }

    /// The value at a frame.
    pub fn at(&self, frame: f64) -> [f64; N] {
        let after = self.keys.partition_point(|key| key.frame <= frame);
        if after == 0 {
            return self.keys[0].value;
        }
        let Some(next) = self.keys.get(after) else { return self.keys[after - 1].value };
        let key = &self.keys[after - 1];
        let span = next.frame - key.frame;
        let s = (frame - key.frame) / span;
        match key.after {
            Between::Hold => key.value,
            Between::Linear => std::array::from_fn(|c| key.value[c] + (next.value[c] - key.value[c]) * s),
            // Cubic Hermite polynomial on [0, 1].
            Between::Smooth => std::array::from_fn(|c| {
                let (a, b) = (key.value[c], next.value[c]);
                let (m, n) = (self.slope(after - 1, c) * span, self.slope(after, c) * span);
                let rise = b - a;
                a + s * (m + s * (3.0 * rise - 2.0 * m - n + s * (m + n - 2.0 * rise)))
            }),
        }
    }

    /// Slope at key `n` of the monotone cubic of Fritsch and Butland (1984): the weighted harmonic mean of the
    /// slopes on both sides where they agree in sign, else zero, and zero where a side is missing or not smooth. Then no
    /// slope exceeds three times a neighbouring chord's, which is enough for monotone pieces (Fritsch and Carlson 1980).
    fn slope(&self, n: usize, c: usize) -> f64 {
        let (Some(before), Some(after)) = (n.checked_sub(1).map(|at| &self.keys[at]), self.keys.get(n + 1)) else {
            return 0.0;
        };
        let key = &self.keys[n];
        if before.after != Between::Smooth || key.after != Between::Smooth {
            return 0.0;
        }
        let (left, right) = (key.frame - before.frame, after.frame - key.frame);
        let (d0, d1) = ((key.value[c] - before.value[c]) / left, (after.value[c] - key.value[c]) / right);
        if d0 * d1 <= 0.0 {
            return 0.0;
        }
        let (w0, w1) = (2.0 * right + left, right + 2.0 * left);
        (w0 + w1) / (w0 / d0 + w1 / d1)
    }

    /// Does each key hold until the next?
    pub(super) fn holds(&self) -> bool {
        self.keys.iter().all(|key| key.after == Between::Hold)
    }

    /// A curve as a script writes it: a value; a list of keys `[frame, value]` or `[frame, value, "hold"]`; or a table of
    /// `keys` and what is `between` those that do not say: by itself a straight line, and for whole numbers a hold.
    pub(super) fn read(value: &Value<'_>, bounds: Bounds, whole: bool) -> Result<Self> {
        let otherwise = if whole { Between::Hold } else { Between::Linear };
        if let Some(table) = value.table() {
            table.only(&["keys", "between"])?;
            let between = table.get("between").map_or(Ok(otherwise), |word| between(&word))?;
            return Self::read_keys(&table.need("keys")?, bounds, whole, between);
        }
        match value.list() {
            Some(items) if items.is_empty() || items[0].list().is_some() => {
                Self::read_keys(value, bounds, whole, otherwise)
            }
            _ => read_value(value, bounds, whole).map(Self::constant),
        }
    }

    fn read_keys(value: &Value<'_>, bounds: Bounds, whole: bool, between_all: Between) -> Result<Self> {
        let form = "a key `[frame, value]`, or `[frame, value, \"linear\" | \"smooth\" | \"hold\"]`";
        let items = value.list().filter(|items| !items.is_empty());
        let items = items.ok_or_else(|| value.refuse("no keys", format!("a list with at least {form}")))?;
        let mut keys: Vec<Key<N>> = Vec::with_capacity(items.len());
        for item in &items {
            let parts = item.list().filter(|parts| matches!(parts.len(), 2 | 3));
            let parts = parts.ok_or_else(|| item.refuse("something else", form))?;
            let frame = parts[0].number(FRAME)?;
            match keys.last().and_then(|last| frame.partial_cmp(&last.frame).map(|order| (last.frame, order))) {
                Some((_, Ordering::Equal)) => {
                    return Err(item.refuse(format!("a second key at frame {frame}"), "one key a frame"));
                }
                Some((last, Ordering::Less)) => {
                    let found = format!("a key at frame {frame} after one at frame {last}");
                    return Err(item.refuse(found, "frames that grow from key to key"));
                }
                _ => {}
            }
            let after = parts.get(2).map_or(Ok(between_all), between)?;
            keys.push(Key { frame, value: read_value(&parts[1], bounds, whole)?, after });
        }
        Ok(Self { keys })
    }
}

fn between(word: &Value<'_>) -> Result<Between> {
    word.choice(&WORDS).map(|n| [Between::Linear, Between::Smooth, Between::Hold][n])
}

fn read_value<const N: usize>(value: &Value<'_>, bounds: Bounds, whole: bool) -> Result<[f64; N]> {
    if N > 1 {
        return value.numbers(bounds);
    }
    Ok([if whole { value.whole(bounds)? } else { value.number(bounds)? }; N])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn curve(keys: &[(f64, f64)], after: Between) -> Curve<1> {
        Curve::new(keys.iter().map(|&(frame, value)| Key { frame, value: [value], after }).collect()).unwrap()
    }

    #[test]
    fn keys_are_met_and_ends_stay() {
        let keys = [(-3.0, 5.0), (0.0, -1.0), (10.5, 7.0)];
        for after in [Between::Linear, Between::Smooth, Between::Hold] {
            let curve = curve(&keys, after);
            keys.iter().for_each(|&(frame, value)| assert_eq!(curve.at(frame), [value], "{after:?}"));
            assert_eq!((curve.at(-100.0), curve.at(11.0)), ([5.0], [7.0]));
        }
        assert_eq!(curve(&keys, Between::Hold).at(10.4), [-1.0]);
        assert_eq!(curve(&keys, Between::Linear).at(-1.0), [1.0]);
    }

    #[test]
    fn two_smooth_keys_are_a_smoothstep() {
        let curve = curve(&[(0.0, 2.0), (8.0, 6.0)], Between::Smooth);
        for n in 0..=8 {
            let s = f64::from(n) / 8.0;
            assert!((curve.at(f64::from(n))[0] - (2.0 + 4.0 * s * s * (3.0 - 2.0 * s))).abs() < 1e-12);
        }
    }

    #[test]
    fn smooth_keys_on_a_line_stay_near_it_in_the_middle() {
        // Away from the ends equal chords give their own slope: the cubic is the line.
        let curve = curve(&[(0.0, 0.0), (10.0, 10.0), (20.0, 20.0), (30.0, 30.0)], Between::Smooth);
        assert!((curve.at(13.3)[0] - 13.3).abs() < 1e-12);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        /// A smooth curve never leaves the values of the two keys around it, and has no jumps in value or slope.
        #[test]
        fn smooth_never_overshoots(steps in prop::collection::vec((0.1f64..50.0, -100.0f64..100.0), 2..8)) {
            let mut frame = 0.0;
            let keys: Vec<(f64, f64)> = steps.iter().map(|&(step, value)| { frame += step; (frame, value) }).collect();
            let curve = curve(&keys, Between::Smooth);
            for pair in keys.windows(2) {
                let ((f0, a), (f1, b)) = (pair[0], pair[1]);
                let mut last = a;
                for n in 0..=40 {
                    let v = curve.at(f0 + (f1 - f0) * f64::from(n) / 40.0)[0];
                    prop_assert!((v - last) * (b - a) >= -1e-9 && v >= a.min(b) - 1e-9 && v <= a.max(b) + 1e-9);
                    last = v;
                }
            }
            for &(f, _) in &keys[1..keys.len() - 1] {
                let h = 1e-5;
                let (before, after) = ((curve.at(f)[0] - curve.at(f - h)[0]) / h, (curve.at(f + h)[0] - curve.at(f)[0]) / h);
                prop_assert!((before - after).abs() < 0.3, "slope {} and {} at {}", before, after, f);
            }
        }
    }
}
