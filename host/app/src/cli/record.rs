//! What is recorded, and which topic of a bag is read.

use std::path::{Path, PathBuf};

use anyhow::ensure;
use clap::Args;

use super::Failure;
use super::shared::RECORD;
use crate::config::RunConfig;
use lrfslam_host::runs::bag::RunBag;
use lrfslam_host::scans::bags::TfWanted;
use lrfslam_host::scans::log::LogOptions;

/// What a run does, as a file to look at.
#[derive(Debug, Args)]
pub(super) struct RecordArgs {
    #[arg(long, value_name = "FILE", help = RECORD)]
    record: Option<PathBuf>,
}

impl RecordArgs {
    /// * `input` — what is read, which is not to be written
    pub(super) fn bag(&self, input: Option<&Path>) -> Result<Option<RunBag>, Failure> {
        let bag = || {
            let Some(path) = &self.record else { return Ok(None) };
            let is_input = input.is_some_and(|input| {
                input.canonicalize().is_ok_and(|input| path.canonicalize().is_ok_and(|path| path == input))
            });
            ensure!(!is_input, "{}: is what is read: record to another file", path.display());
            RunBag::at(path).map(Some)
        };
        bag().map_err(Failure::Start)
    }
}

/// Which scans of a bag.
#[derive(Debug, Args)]
pub(super) struct TopicArgs {
    /// Of a bag: the topic with the scans, such as /scan [default: the only one that has any].
    #[arg(long, value_name = "TOPIC", value_parser = for_ever)]
    topic: Option<&'static str>,
    /// Of a bag of ROS: where the laser sits on the robot, by the frames of /tf_static. ROBOT is the robot's frame.
    ///
    /// Without ROBOT it is base_link, or base_footprint if there is no base_link. The laser's frame is the one that its scans name. What is found
    /// is said, and takes the place of the configuration's `mounting`.
    #[arg(long, value_name = "ROBOT", num_args = 0..=1, require_equals = true, default_missing_value = "", value_parser = frame)]
    tf_mounting: Option<Frame>,
}

/// Odometry out of a bag's frames.
#[derive(Debug, Args)]
pub(super) struct TfOdometryArgs {
    /// Of a bag of ROS: predict motion by the frames of /tf, for a bag without nav_msgs/Odometry. ODOM and ROBOT are frames.
    ///
    /// Without them it is odom → base_link, or odom → base_footprint if there is no base_link.
    #[arg(
        long,
        value_name = "ODOM,ROBOT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "odom",
        value_parser = two_frames,
        conflicts_with = "odometry"
    )]
    tf_odometry: Option<(&'static str, Frame)>,
}

/// A frame, if it is named.
type Frame = Option<&'static str>;

impl TopicArgs {
    /// How a log is read.
    pub(super) fn log_options(&self, config: &RunConfig) -> LogOptions {
        let options = config.log_options();
        let robot_from_lrf = options.robot_from_lrf.filter(|_| self.tf_mounting.is_none());
        let tf =
            TfWanted { mounting: self.tf_mounting.is_some(), robot_frame: self.tf_mounting.flatten(), ..options.tf };
        LogOptions { topic: self.topic, robot_from_lrf, tf, ..options }
    }
}

impl TfOdometryArgs {
    /// Some is wanted.
    pub(super) fn is_wanted(&self) -> bool {
        self.tf_odometry.is_some()
    }

    /// How a log is read that is to have it.
    pub(super) fn with_odometry(&self, options: LogOptions) -> anyhow::Result<LogOptions> {
        let Some((odometry, robot)) = self.tf_odometry else { return Ok(options) };
        let other = options.tf.robot_frame;
        ensure!(
            other.is_none() || robot.is_none() || other == robot,
            "--tf-odometry and --tf-mounting name two frames of the robot: expected one"
        );
        let tf = TfWanted { odometry_frame: Some(odometry), robot_frame: robot.or(other), ..options.tf };
        Ok(LogOptions { tf, ..options })
    }
}

/// The name of a frame; nothing stands for the usual one.
fn frame(text: &str) -> Result<Frame, String> {
    let name = text.trim_start_matches('/');
    if name.contains([',', ' ']) || (name.is_empty() && !text.is_empty()) {
        return Err("expected the name of a frame, such as base_link".to_owned());
    }
    // There is one for as long as the program runs.
    Ok((!name.is_empty()).then(|| &*name.to_owned().leak()))
}

/// Names of the odometry's frame and, perhaps, of the robot's.
fn two_frames(text: &str) -> Result<(&'static str, Frame), String> {
    let (odometry, robot) = text.split_once(',').map_or((text, None), |(odometry, robot)| (odometry, Some(robot)));
    let expected = || "expected names of frames, such as odom,base_link".to_owned();
    let robot = robot.map(|robot| frame(robot).ok().flatten().ok_or_else(expected)).transpose()?;
    Ok((frame(odometry).ok().flatten().ok_or_else(expected)?, robot))
}

/// There is one for as long as the program runs.
fn for_ever(topic: &str) -> Result<&'static str, std::convert::Infallible> {
    Ok(topic.to_owned().leak())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_named_or_the_usual_ones() {
        assert_eq!(two_frames("odom"), Ok(("odom", None)));
        assert_eq!(two_frames("/odom_combined,/base_footprint"), Ok(("odom_combined", Some("base_footprint"))));
        assert_eq!((frame(""), frame("robot/base")), (Ok(None), Ok(Some("robot/base"))));
        for wrong in ["", ",", "odom,", ",base_link", "a,b,c", "a b", "/"] {
            assert!(two_frames(wrong).is_err(), "{wrong:?}");
        }
        assert!(frame("/").is_err() && frame("a,b").is_err());
    }
}
