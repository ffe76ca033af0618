//! Frames as a bag tells them: each in its parent, and the way from one to another.
//!
//! Source: REP 105; `tf2_msgs/TFMessage`. A frame has one parent: the last that was told, or the one that `/tf_static` says.

use std::collections::BTreeMap;

use lrfslam_core::time::Instant;
use nalgebra::Isometry3;

/// So many frames are kept; a robot has some dozens.
const FRAMES_MAX: usize = 10_000;
/// So many frames are named in words.
const NAMED_MAX: usize = 30;
/// A frame of `/tf` that was told so often without moving is taken to be fixed.
const STILL: u32 = 10;
/// What still counts as not moving, m and rad.
const STILL_WITHIN: f64 = 1e-6;

/// A frame in its parent, at a time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Transform {
    pub stamp: Instant,
    pub parent: String,
    pub child: String,
    /// m.
    pub parent_from_child: Isometry3<f64>,
}

#[derive(Debug, Clone)]
struct Edge {
    stamp: Instant,
    parent: String,
    parent_from_child: Isometry3<f64>,
    is_static: bool,
    /// How often it was told in the same place.
    still: u32,
    has_moved: bool,
}

/// The way from a frame to one above it.
#[derive(Debug, Clone)]
pub(super) struct Chain {
    pub parent_from_child: Isometry3<f64>,
    /// From the upper one to the lower one.
    pub names: Vec<String>,
    /// Of what was told last of those that move. What stays may be stamped by anything, even ahead.
    pub newest: Option<Instant>,
    /// None of them moves.
    pub is_fixed: bool,
}

/// All frames, by name.
#[derive(Debug, Clone, Default)]
pub(super) struct Frames(BTreeMap<String, Edge>);

impl Frames {
    /// Takes what is told of a frame; more frames than can be kept are left out.
    pub fn add(&mut self, told: Transform, is_static: bool) {
        let Transform { stamp, parent, child, parent_from_child } = told;
        let before = self.0.get(&child);
        // A publisher of both says the same.
        if before.is_some_and(|before| before.is_static && !is_static)
            || (before.is_none() && self.0.len() >= FRAMES_MAX)
        {
            return;
        }
        let (still, has_moved) = before.map_or((1, false), |before| {
            let off = before.parent_from_child.inverse() * parent_from_child;
            let is_still = off.translation.vector.norm() <= STILL_WITHIN && off.rotation.angle() <= STILL_WITHIN;
            (before.still.saturating_add(1), before.has_moved || !is_still || before.parent != parent)
        });
        self.0.insert(child, Edge { stamp, parent, parent_from_child, is_static, still, has_moved });
    }

    /// The way from `parent` down to `child`; `None` if there is none.
    pub fn chain(&self, parent: &str, child: &str) -> Option<Chain> {
        let mut chain = Chain {
            parent_from_child: Isometry3::identity(),
            names: vec![child.to_owned()],
            newest: None,
            is_fixed: true,
        };
        let (mut at, mut unmoved) = (child, None);
        while at != parent {
            let edge = self.0.get(at).filter(|_| chain.names.len() <= self.0.len())?;
            chain.parent_from_child = edge.parent_from_child * chain.parent_from_child;
            if !edge.is_static {
                let newest = if edge.has_moved { &mut chain.newest } else { &mut unmoved };
                *newest = (*newest).max(Some(edge.stamp));
            }
            chain.is_fixed &= edge.is_static || (edge.still >= STILL && !edge.has_moved);
            at = &edge.parent;
            chain.names.push(at.to_owned());
        }
        chain.names.reverse();
        chain.newest = chain.newest.or(unmoved);
        Some(chain)
    }

    /// All frames in words, each behind its parent.
    pub fn words(&self) -> String {
        if self.0.is_empty() {
            return "none".to_owned();
        }
        let word = |(child, edge): (&String, &Edge)| {
            let kind = if edge.is_static { " (static)" } else { "" };
            format!("{} → {child}{kind}", edge.parent)
        };
        let words: Vec<_> = self.0.iter().take(NAMED_MAX).map(word).collect();
        let more = if self.0.len() > NAMED_MAX { ", …" } else { "" };
        words.join(", ") + more
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion};

    use super::*;

    fn told(parent: &str, child: &str, x: f64, yaw: f64) -> Transform {
        let parent_from_child =
            Isometry3::from_parts(Translation3::new(x, 0.0, 0.3), UnitQuaternion::from_euler_angles(0.0, 0.0, yaw));
        Transform { stamp: Instant::from_micros(7), parent: parent.into(), child: child.into(), parent_from_child }
    }

    #[test]
    fn a_chain_goes_through_frames_between() {
        let mut frames = Frames::default();
        frames.add(told("base_link", "plate", 1.0, std::f64::consts::FRAC_PI_2), true);
        frames.add(told("plate", "laser", 0.5, 0.0), true);
        let chain = frames.chain("base_link", "laser").unwrap();
        assert_eq!(chain.names, ["base_link", "plate", "laser"]);
        let at = chain.parent_from_child.translation.vector;
        assert!((at - nalgebra::Vector3::new(1.0, 0.5, 0.6)).norm() < 1e-12 && chain.is_fixed);
        assert!(frames.chain("laser", "base_link").is_none() && frames.chain("odom", "laser").is_none());
        assert_eq!(frames.words(), "plate → laser (static), base_link → plate (static)");
    }

    #[test]
    fn a_circle_of_frames_has_no_end_to_be_found() {
        let mut frames = Frames::default();
        frames.add(told("a", "b", 1.0, 0.0), false);
        frames.add(told("b", "a", 1.0, 0.0), false);
        assert!(frames.chain("odom", "a").is_none());
    }

    #[test]
    fn what_never_moves_is_fixed_and_static_frames_stay() {
        let mut frames = Frames::default();
        for _ in 1..STILL {
            frames.add(told("base_link", "laser", 0.2, 0.0), false);
        }
        assert!(!frames.chain("base_link", "laser").unwrap().is_fixed, "it was told too seldom");
        frames.add(told("base_link", "laser", 0.2, 0.0), false);
        assert!(frames.chain("base_link", "laser").unwrap().is_fixed);
        frames.add(told("base_link", "laser", 0.2, 0.1), false);
        frames.add(told("base_link", "laser", 0.2, 0.0), false);
        assert!(!frames.chain("base_link", "laser").unwrap().is_fixed, "it has moved");
        frames.add(told("base_link", "laser", 0.7, 0.0), true);
        frames.add(told("base_link", "laser", 0.2, 0.0), false);
        let chain = frames.chain("base_link", "laser").unwrap();
        assert!(chain.is_fixed && chain.parent_from_child.translation.x == 0.7);
    }

    #[test]
    fn a_pose_is_of_the_time_of_what_moves() {
        let mut frames = Frames::default();
        let at = |micros, told| Transform { stamp: Instant::from_micros(micros), ..told };
        frames.add(at(900, told("base_footprint", "base_link", 0.0, 0.0)), false);
        frames.add(at(999, told("base_link", "laser", 0.0, 0.0)), true);
        for micros in [100, 200] {
            frames.add(at(micros, told("odom", "base_footprint", micros as f64, 0.0)), false);
        }
        let newest = |child| frames.chain("odom", child).unwrap().newest;
        assert_eq!((newest("base_link"), newest("laser")), (Some(Instant::from_micros(200)), newest("base_footprint")));
    }

    #[test]
    fn frames_without_end_are_not_kept() {
        let mut frames = Frames::default();
        (0..FRAMES_MAX + 5).for_each(|number| frames.add(told("map", &number.to_string(), 0.0, 0.0), false));
        assert_eq!(frames.0.len(), FRAMES_MAX);
        assert!(frames.words().len() < 1000);
    }
}
