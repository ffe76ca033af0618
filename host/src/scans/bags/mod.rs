//! Bags: messages of robots, recorded by ROS 2 (MCAP, or SQLite `.db3`), by ROS 1 (`.bag`), or by this program (MCAP). No ROS is needed.
//!
//! Data flow: file → container → messages → scans of one topic, each with the odometry at its time. What a file is, its
//! first bytes tell. Scans are `sensor_msgs/LaserScan` (CDR or ROS 1's form) and `foxglove.LaserScan` (JSON); odometry is `nav_msgs/Odometry`, or
//! the robot among the frames of `tf2_msgs/TFMessage`, which also tell where the laser is on it ([`TfWanted`]).
//!
//! A message that cannot be read is left out and told. A file that is cut is read as far as it goes.
//!
//! Not here: point clouds, bags that `ros2 bag` has compressed as whole files.

mod container;
mod frames;
mod messages;
mod odometry;
mod ros1;
mod sqlite;
mod tf;
mod wire;

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::Beam;
use lrfslam_core::time::{Duration, Instant};

use self::container::{Container, Next};
use self::odometry::Odometry;
use crate::input::text::FieldFault;
use crate::pose_f64::PoseF64;
use crate::scans::mcap::{self, Channel};

pub use self::container::{BagKind, bag_kind};
pub(crate) use self::messages::scan as scan_of;
pub use self::tf::{TfFault, TfWanted};

/// A scan as a bag has it.
#[derive(Debug, Clone, PartialEq)]
pub struct BagScan {
    /// Of its message in the bag, from 1.
    pub number: u64,
    /// By its header; by the bag if that has none.
    pub stamp: Instant,
    /// What it measured.
    pub ranges: Ranges,
    /// The robot by its odometry at that time, in the odometry's own frame.
    pub odometry_from_robot: Option<PoseF64>,
    /// Where the laser is on the robot, if the scan says it.
    pub robot_from_lrf: Option<Pose2>,
}

/// What a scan measured.
#[derive(Debug, Clone, PartialEq)]
pub enum Ranges {
    /// Evenly, and what a range means is to be judged.
    Even {
        /// As they stand there, m; NaN is none.
        ranges_m: Vec<f32>,
        /// Bearing of the first, rad, and from one to the next, positive.
        bearings_rad: [f32; 2],
        /// Time of the first after the stamp, and from one to the next.
        offsets: [Duration; 2],
        /// As the message declares it, m.
        range_max_m: Option<f32>,
    },
    /// Exactly as a driver gave them.
    Exact {
        /// In order of bearing.
        beams: Vec<Beam>,
        /// A miss means: nothing nearer than this, m.
        range_max_m: f32,
    },
}

/// What comes next out of a bag.
#[derive(Debug)]
pub enum Taken {
    /// A scan.
    Scan(Box<BagScan>),
    /// A message, or a part of the file, that cannot be read: its number, and what is wrong.
    Damaged(u64, FieldFault),
    /// The file ends in the middle.
    Cut,
    /// Nothing more.
    End,
}

/// Scans out of a bag; see the [module](self).
pub struct Bag {
    container: Box<dyn Container>,
    /// Of a bag in several files, those still to come.
    files: VecDeque<PathBuf>,
    /// Sizes of the files that were read.
    read_before: u64,
    wanted: Option<&'static str>,
    scans_from: Option<Arc<Channel>>,
    odometry_from: Option<Arc<Channel>>,
    /// Names and types of the topics met.
    topics: BTreeMap<String, String>,
    odometry: Odometry,
    /// What is read of its frames.
    tf: tf::Found,
    ready: VecDeque<Taken>,
    number: u64,
    is_over: bool,
}

impl std::fmt::Debug for Bag {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Bag").field("topics", &self.topics).finish_non_exhaustive()
    }
}

/// The files of a bag at `path`: itself, or those in a folder of ROS 2, in order of name. None if it is no such folder.
pub fn bag_files(path: &Path) -> Vec<PathBuf> {
    if !path.is_dir() {
        return vec![path.to_owned()];
    }
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_bag = |file: &PathBuf| file.extension().is_some_and(|ending| ending == "mcap" || ending == "db3");
    let mut files: Vec<PathBuf> = entries.filter(is_bag).collect();
    // `name_2` comes before `name_10`.
    files.sort_by_key(|file| (file.as_os_str().len(), file.clone()));
    files
}

impl Bag {
    /// Opens the files of a bag; scans come from the topic `wanted`, or from the only one that has any.
    ///
    /// # Errors
    /// If the first cannot be opened, or is no bag.
    pub fn open(files: Vec<PathBuf>, wanted: Option<&'static str>) -> io::Result<Self> {
        let mut files = VecDeque::from(files);
        let first = files.pop_front().ok_or_else(|| io::Error::other("there is no bag in the folder"))?;
        Ok(Self::of(container::open(&first)?, files, wanted))
    }

    /// A bag that is a single file.
    ///
    /// # Errors
    /// If it is no bag.
    pub fn from_reader(input: impl Read + Seek + Send + 'static, wanted: Option<&'static str>) -> io::Result<Self> {
        Ok(Self::of(container::from_reader(Box::new(input))?, VecDeque::new(), wanted))
    }

    fn of(container: Box<dyn Container>, files: VecDeque<PathBuf>, wanted: Option<&'static str>) -> Self {
        Self {
            container,
            files,
            read_before: 0,
            wanted,
            scans_from: None,
            odometry_from: None,
            topics: BTreeMap::new(),
            odometry: Odometry::default(),
            tf: tf::Found::default(),
            ready: VecDeque::new(),
            number: 0,
            is_over: false,
        }
    }

    /// Looks for frames in all of `files`, which are those of the bag; scans then come with what they say.
    ///
    /// # Errors
    /// If a frame is missing, or the laser leans.
    pub fn find_frames(&mut self, files: &[PathBuf], wanted: &TfWanted) -> Result<(), TfFault> {
        let bags = files.iter().filter_map(|file| container::open(file).ok());
        self.tf = tf::look(bags, self.wanted, wanted)?;
        Ok(())
    }

    /// The same for a bag that is a single file.
    ///
    /// # Errors
    /// As there.
    pub fn find_frames_in(
        &mut self,
        input: impl Read + Seek + Send + 'static,
        wanted: &TfWanted,
    ) -> Result<(), TfFault> {
        let bag = container::from_reader(Box::new(input)).ok();
        self.tf = tf::look(bag.into_iter(), self.wanted, wanted)?;
        Ok(())
    }

    /// What was found among the frames, in words.
    pub fn frames_found(&self) -> &[String] {
        &self.tf.words
    }

    /// Bytes of the files that were read.
    pub fn position(&self) -> u64 {
        self.read_before + self.container.position()
    }

    /// Topics that have scans, as far as they were met.
    pub fn scan_topics(&self) -> Vec<&str> {
        let with_scans = self.topics.iter().filter(|(_, kind)| messages::is_scan(kind));
        with_scans.map(|(topic, _)| topic.as_str()).collect()
    }

    /// Topics met, with their types, in words.
    pub fn topics(&self) -> String {
        let all: Vec<_> = self.topics.iter().map(|(topic, kind)| format!("{topic} ({kind})")).collect();
        if all.is_empty() { "none".to_owned() } else { all.join(", ") }
    }

    /// The next scan, or what else there is.
    pub fn take(&mut self) -> Taken {
        loop {
            if let Some(ready) = self.ready.pop_front() {
                return ready;
            }
            if self.is_over {
                return Taken::End;
            }
            match self.container.next() {
                Next::Message(message) => self.take_message(message),
                Next::Damaged(fault) => return Taken::Damaged(self.number, fault),
                Next::End { is_cut } => self.end_file(is_cut),
            }
        }
    }

    fn end_file(&mut self, is_cut: bool) {
        if is_cut {
            self.ready.push_back(Taken::Cut);
        }
        self.read_before += self.container.position();
        match self.files.pop_front().map(|file| (container::open(&file), file)) {
            Some((Ok(next), _)) => self.container = next,
            Some((Err(error), file)) => {
                let field = file.display().to_string();
                let fault = FieldFault { field, expected: "a bag".to_owned(), found: error.to_string() };
                self.ready.push_back(Taken::Damaged(self.number, fault));
            }
            None => {
                self.is_over = true;
                let rest: Vec<_> = self.odometry.finish().collect();
                self.put(rest);
            }
        }
    }

    fn take_message(&mut self, message: mcap::Message) {
        self.number += 1;
        let channel = &message.channel;
        if !self.topics.contains_key(&channel.topic) {
            self.topics.insert(channel.topic.clone(), messages::plain_type(&channel.schema));
        }
        let is_of =
            |from: &mut Option<Arc<Channel>>| from.get_or_insert_with(|| channel.clone()).topic == channel.topic;
        let is_wanted = self.wanted.is_none_or(|topic| topic == channel.topic);
        let read = if messages::is_scan(&channel.schema) && is_wanted && is_of(&mut self.scans_from) {
            messages::scan(self.number, &message).map(|scan| self.odometry.add_scan(scan))
        } else if messages::is_tf(&channel.schema) && self.tf.has_odometry() {
            let told = self.tf.take(&message);
            told.map(|told| told.into_iter().for_each(|(stamp, pose)| self.odometry.add(stamp, pose)))
        } else if messages::is_odometry(&channel.schema) && !self.tf.has_odometry() && is_of(&mut self.odometry_from) {
            messages::odometry(&message).map(|(stamp, pose)| self.odometry.add(stamp, pose))
        } else {
            return;
        };
        let ready: Vec<_> = self.odometry.ready().collect();
        self.put(ready);
        self.ready.extend(read.err().map(|fault| Taken::Damaged(self.number, fault)));
    }

    /// Scans that nothing more is to come of.
    fn put(&mut self, scans: Vec<BagScan>) {
        let robot_from_lrf = self.tf.robot_from_lrf;
        let placed = |scan: BagScan| BagScan { robot_from_lrf: robot_from_lrf.or(scan.robot_from_lrf), ..scan };
        self.ready.extend(scans.into_iter().map(|scan| Taken::Scan(Box::new(placed(scan)))));
    }
}

#[cfg(test)]
mod tests;
