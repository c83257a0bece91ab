//! From highlights to lamps: which spot of each photograph is the lamp, and what is doubtful about it.

use std::fmt;

use super::highlight::{Spot, Spots};
use super::near::{Line, triangulate};
use crate::math::{Vec3, angle_between};

/// A highlight whose peak is below this share of the set's median is a lamp that was off, hidden, or lights the ball
/// through the room only; real lamps of one rig differ by less than twenty times on one ball.
const FAINT: f32 = 0.05;
/// A spot this many times as large as the set's median (and more than this many pixels) is no lamp of the set.
const LARGE_TIMES: f64 = 6.0;
const LARGE_PIXELS: f64 = 20.0;
/// A spot that fills this share of the ball is a window or a wall.
const LARGE_SHARE: f64 = 0.06;
/// Clipped spots wider than this share of the ball: their middle is a guess.
const FLAT_SHARE: f64 = 0.005;
/// From this share of the radius on, one pixel at a radius of 100 is more than 5 degrees (2 / sqrt(1 - r^2) / R).
const RIM: f64 = 0.975;

/// What is wrong with a photograph, or may be. Balls count from 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Doubt {
    /// No highlight.
    Missing {
        /// Which ball.
        ball: usize,
    },
    /// More than one.
    Doubled {
        /// Which ball.
        ball: usize,
        /// How many.
        count: usize,
    },
    /// Far larger than the others.
    TooLarge {
        /// Which ball.
        ball: usize,
        /// Times the median.
        times: f64,
    },
    /// Large, and clipped all over.
    Clipped {
        /// Which ball.
        ball: usize,
    },
    /// At the rim of the ball, where directions are crowded.
    NearRim {
        /// Which ball.
        ball: usize,
        /// In radii.
        radius: f64,
    },
    /// Balls tell different directions.
    Disagree {
        /// By how much at least.
        degrees: f64,
    },
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing { ball } => write!(f, "no highlight on ball {ball}"),
            Self::Doubled { ball, count } => write!(f, "{count} highlights on ball {ball}"),
            Self::TooLarge { ball, times } => {
                write!(f, "the highlight on ball {ball} is {times:.0} times as large as usual")
            }
            Self::Clipped { ball } => write!(f, "the highlight on ball {ball} is large and clipped flat"),
            Self::NearRim { ball, radius } => {
                write!(f, "the highlight on ball {ball} is near the rim, at {radius:.3} of the radius")
            }
            Self::Disagree { degrees } => write!(f, "the balls disagree by {degrees:.1} degrees"),
        }
    }
}

/// Where balls stand, in metres of the stage frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    /// Middle.
    pub middle_m: Vec3,
    /// Radius.
    pub radius_m: f64,
}

impl Stand {
    fn line(&self, spot: &Spot) -> Line {
        Line { origin: self.middle_m + spot.normal * self.radius_m, direction: spot.direction }
    }
}

/// How spots are judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Rules {
    /// Balls agree when their directions (or, of near lamps, their lines of sight) miss each other by no more than
    /// this.
    pub agree_rad: f64,
    /// Pixels in each ball's disc.
    pub disc_px: Vec<f64>,
    /// Where the balls stand; without it lamps are at infinity.
    pub stands: Option<Vec<Stand>>,
    /// Distance of every lamp from the stage's origin, where it is known.
    pub distance_m: Option<f64>,
}

/// What one photograph told.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Lamp {
    /// Unit direction from the object to the lamp; `None` where nothing can be told.
    pub direction: Option<Vec3>,
    /// Its place, metres in the stage frame, where that can be told.
    pub position_m: Option<Vec3>,
    /// What is doubtful.
    pub doubts: Vec<Doubt>,
}

/// A spot and the ball (from 0) that shows it.
type Seen = (usize, Spot);

/// Judges a set: `seen[photograph][ball]`.
pub fn judge(seen: &[Vec<Spots>], rules: &Rules) -> Vec<Lamp> {
    let balls = seen.first().map_or(0, Vec::len);
    let typical = |value: &dyn Fn(&Spots) -> Option<f64>, ball: usize| {
        let mut all: Vec<f64> = seen.iter().filter_map(|photograph| value(&photograph[ball])).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(0.0)
    };
    let peaks: Vec<f64> =
        (0..balls).map(|b| typical(&|s| (!s.spots.is_empty()).then_some(f64::from(s.peak)), b)).collect();
    let areas: Vec<f64> = (0..balls).map(|b| typical(&|s| Some(s.spots.first()?.area as f64), b)).collect();
    let one = |photograph: &Vec<Spots>| {
        let mut doubts = Vec::new();
        let mut spots: Vec<Seen> = Vec::new();
        for (b, shown) in photograph.iter().enumerate() {
            if shown.spots.is_empty() || f64::from(shown.peak) < f64::from(FAINT) * peaks[b] {
                doubts.push(Doubt::Missing { ball: b + 1 });
                continue;
            }
            let large = |spot: &Spot| {
                let area = spot.area as f64;
                (area > LARGE_TIMES * areas[b] && area > LARGE_PIXELS) || area > LARGE_SHARE * rules.disc_px[b]
            };
            if let Some(spot) = shown.spots.iter().find(|spot| large(spot)) {
                doubts.push(Doubt::TooLarge { ball: b + 1, times: spot.area as f64 / areas[b].max(1.0) });
            }
            let good = shown.spots.iter().filter(|spot| !large(spot));
            spots.extend(good.map(|spot| (b, *spot)));
        }
        resolve(&spots, doubts, rules)
    };
    seen.iter().map(one).collect()
}

/// Chooses among the spots of one photograph.
fn resolve(spots: &[Seen], mut doubts: Vec<Doubt>, rules: &Rules) -> Lamp {
    let mut counts = vec![0usize; rules.disc_px.len()];
    spots.iter().for_each(|(ball, _)| counts[*ball] += 1);
    let doubled =
        (0..counts.len()).filter(|&b| counts[b] > 1).map(|b| Doubt::Doubled { ball: b + 1, count: counts[b] });
    doubts.extend(doubled);
    // For each spot, itself and the spot of every other ball that agrees with it best.
    let party = |seed: &Seen| -> Vec<Seen> {
        let other = |ball: usize| {
            let candidates = spots.iter().filter(|(b, _)| *b == ball).map(|s| (miss(seed, s, rules), *s));
            candidates.filter(|(off, _)| *off <= rules.agree_rad).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, s)| s)
        };
        (0..counts.len()).filter_map(|ball| if ball == seed.0 { Some(*seed) } else { other(ball) }).collect()
    };
    let parties: Vec<Vec<Seen>> = spots.iter().map(party).collect();
    let most = parties.iter().map(Vec::len).max().unwrap_or(0);
    let strong: Vec<&Vec<Seen>> = parties.iter().filter(|p| p.len() == most).collect();
    let Some(best) = strong.first() else { return Lamp { doubts, ..Lamp::default() } };
    // Equally large parties without a spot in common: nobody can tell which is the lamp.
    if let Some(rival) = strong.iter().find(|p| !p.iter().any(|s| best.contains(s))) {
        if rival[0].0 != best[0].0 || most > 1 || counts.iter().filter(|c| **c > 0).count() > 1 {
            doubts.push(Doubt::Disagree { degrees: miss(&best[0], &rival[0], rules).to_degrees() });
        }
        return Lamp { doubts, ..Lamp::default() };
    }
    for (ball, spot) in best.iter() {
        if spot.radius > RIM {
            doubts.push(Doubt::NearRim { ball: ball + 1, radius: spot.radius });
        }
        if spot.clipped * 5 > spot.area * 4 && spot.area as f64 > FLAT_SHARE * rules.disc_px[*ball] {
            doubts.push(Doubt::Clipped { ball: ball + 1 });
        }
    }
    place(best, doubts, rules)
}

/// By how much two balls miss each other, as an angle.
fn miss(a: &Seen, b: &Seen, rules: &Rules) -> f64 {
    let plain = angle_between(&a.1.direction, &b.1.direction);
    let Some(stands) = &rules.stands else { return plain };
    let lines = [stands[a.0].line(&a.1), stands[b.0].line(&b.1)];
    let off =
        |point: Vec3| lines.iter().map(|l| angle_between(&(point - l.origin).normalize(), &l.direction)).sum::<f64>();
    triangulate(&lines).map_or(plain, |point| plain.min(off(point)))
}

/// Direction and place from spots that agree. Of spots near the rim and others the others count more: a pixel's worth
/// of direction grows as `1 / sqrt(1 - r^2)`, so weights are `1 - r^2`.
fn place(party: &[Seen], doubts: Vec<Doubt>, rules: &Rules) -> Lamp {
    let weight = |spot: &Spot| (1.0 - spot.radius * spot.radius).max(1e-3);
    let mean: Vec3 = party.iter().map(|(_, spot)| spot.direction * weight(spot)).sum();
    let direction = mean.normalize();
    let position_m = rules.stands.as_ref().and_then(|stands| {
        let lines: Vec<Line> = party.iter().map(|(ball, spot)| stands[*ball].line(spot)).collect();
        let known = |distance: f64| {
            let points: Vec<Vec3> = lines.iter().filter_map(|line| line.at_distance(distance)).collect();
            (!points.is_empty()).then(|| points.iter().sum::<Vec3>() / points.len() as f64)
        };
        rules.distance_m.map_or_else(|| triangulate(&lines), known)
    });
    let direction = position_m.and_then(|p| p.try_normalize(1e-9)).unwrap_or(direction);
    Lamp { direction: Some(direction), position_m, doubts }
}

/// The lamp of a photograph whose highlight a person has pointed at.
pub fn pointed_at(ball: usize, direction: Vec3, normal: Vec3, rules: &Rules) -> Lamp {
    let spot = Spot { x: 0.0, y: 0.0, direction, normal, power: 1.0, area: 1, clipped: 0, radius: 0.0 };
    place(&[(ball, spot)], Vec::new(), rules)
}
