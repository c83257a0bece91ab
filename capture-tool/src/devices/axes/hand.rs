//! Axes that the operator turns by hand.

use std::sync::Arc;

use super::{Axes, Place};
use crate::devices::{Finding, Operator, Trouble};

/// A person at the turntable.
pub struct Hand {
    operator: Arc<dyn Operator>,
    /// Where the operator was asked to put them last.
    at: Place,
}

impl Hand {
    /// Asks this person.
    pub fn new(operator: &Arc<dyn Operator>) -> Self {
        Self { operator: operator.clone(), at: Place::default() }
    }

    fn ask(&self, to: Place) -> Result<(), Trouble> {
        let turn = to.turntable_deg.map(|deg| format!("turn the table to {} degrees", tidy(deg)));
        let lift = to.arm_deg.map(|deg| format!("lift the arm to {} degrees", tidy(deg)));
        let parts: Vec<String> = [turn, lift].into_iter().flatten().collect();
        if parts.is_empty() { Ok(()) } else { self.operator.ask(&parts.join(" and ")) }
    }
}

/// Hundredths of a degree, and no zeros behind.
fn tidy(deg: f64) -> f64 {
    (deg * 100.0).round() / 100.0 + 0.0
}

impl Axes for Hand {
    fn preflight(&mut self) -> Vec<Finding> {
        vec![Finding::fine("axes: turned by hand, when asked to")]
    }

    /// Nothing to find: scales are read by the operator.
    fn home(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    fn go(&mut self, to: Place) -> Result<(), Trouble> {
        let changed = |to: Option<f64>, at: Option<f64>| to.filter(|_| to != at);
        self.ask(Place {
            turntable_deg: changed(to.turntable_deg, self.at.turntable_deg),
            arm_deg: changed(to.arm_deg, self.at.arm_deg),
        })?;
        self.at = Place {
            turntable_deg: to.turntable_deg.or(self.at.turntable_deg),
            arm_deg: to.arm_deg.or(self.at.arm_deg),
        };
        Ok(())
    }

    fn place(&mut self) -> Result<Place, Trouble> {
        Ok(self.at)
    }

    fn hold(&mut self) -> Result<(), Trouble> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::operator::Willing;

    #[test]
    fn the_operator_is_asked_once_a_place() {
        let willing = Arc::new(Willing::default());
        let operator: Arc<dyn Operator> = willing.clone();
        let mut hand = Hand::new(&operator);
        let at = |deg| Place { turntable_deg: Some(deg), arm_deg: None };
        for deg in [0.0, 90.0, 90.0, 97.125] {
            hand.go(at(deg)).unwrap();
        }
        hand.go(Place { turntable_deg: Some(97.125), arm_deg: Some(30.0) }).unwrap();
        hand.go(Place { turntable_deg: Some(0.0), arm_deg: Some(45.0) }).unwrap();
        let asked = willing.asked.lock().unwrap().clone();
        assert_eq!(
            asked[..3],
            ["turn the table to 0 degrees", "turn the table to 90 degrees", "turn the table to 97.13 degrees"]
        );
        assert_eq!(
            asked[3..],
            ["lift the arm to 30 degrees", "turn the table to 0 degrees and lift the arm to 45 degrees"]
        );
        assert_eq!(hand.place().unwrap(), Place { turntable_deg: Some(0.0), arm_deg: Some(45.0) });
    }
}
