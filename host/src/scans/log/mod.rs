//! Recorded laser logs: CARMEN, DP-SLAM, tinySLAM and YDLIDAR X4, plain or gzip, and [bags](crate::scans::bags), scan by scan.
//!
//! Data flow: file → lines → the format's reader → raw scan → [`LogScan`]: beams that hit, missed or are invalid, the
//! robot's odometry and the laser's mounting. The format is known from the content, never from the name. The first
//! [`LOOK_AHEAD`] scans are read before the first is handed out, to find the maximum range and the mounting.
//!
//! Scans come in file order under their own times. Times running backwards are normal in real logs, and counted; so are
//! lines of unknown kinds. A damaged line is passed over: [`LogCounts`] counts it and names its field. A last line cut
//! short ends the log with a flag. What keeps the rest from being read is a [`LogError`] after the scans before.
//!
//! The number of beams may change from scan to scan where the line gives its angles, or the number is a known device's.

mod bag;
mod carmen;
mod counts;
mod dpslam;
mod error;
mod format;
mod mounting;
mod range_limit;
mod raw;
mod stamps;
mod tinyslam;
mod told;
mod ydlidar;

use std::collections::VecDeque;
use std::io::Read;
use std::path::Path;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::{Beam, RangeScan};
use lrfslam_core::time::{Duration, Instant};

pub use counts::{DamagedLine, LogCounts};
pub use error::LogError;
pub use format::LogFormat;
pub use range_limit::{LimitOrigin, RangeNotes};
pub use told::ToldScans;

use self::bag::{Source, bag_at};
use self::mounting::Mounting;
use self::range_limit::RangeLimit;
use self::raw::{Bearings, Content, LineReader, RawScan};
use self::stamps::Stamps;
use crate::input::text::{ByteCount, FieldFault, LINE_BYTES_MAX, Line, LineFault, Lines, fault};
use crate::scans::bags::TfWanted;

/// Scans read before the first is handed out.
pub const LOOK_AHEAD: usize = 32;

/// Lines of no known kind after which a file is not a log.
const LINES_BEFORE_GIVING_UP: u64 = 1000;

/// What the caller knows better than the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogOptions {
    /// Ranges from here on are misses, m; `None`: as the log says or shows.
    pub range_max_m: Option<f32>,
    /// The beams lie evenly over this angle, rad; `None`: as the log says, else by the number of beams.
    pub field_of_view_rad: Option<f32>,
    /// Pose of the laser on the robot; `None`: from the log.
    pub robot_from_lrf: Option<Pose2>,
    /// From scan to scan in a log without times (DP-SLAM's).
    pub scan_interval: Duration,
    /// Scans of a bag are those of this topic; `None`: of the only one that has any.
    pub topic: Option<&'static str>,
    /// What is read of the frames of a bag.
    pub tf: TfWanted,
}

impl Default for LogOptions {
    fn default() -> Self {
        let scan_interval = Duration::from_millis(200);
        let tf = TfWanted::default();
        Self { range_max_m: None, field_of_view_rad: None, robot_from_lrf: None, scan_interval, topic: None, tf }
    }
}

/// One scan of a log, or of a laser.
#[derive(Debug, Clone, PartialEq)]
pub struct LogScan {
    /// Its time on the log's clock.
    pub stamp: Instant,
    /// A miss means: nothing nearer than this, m.
    pub range_max_m: f32,
    /// In order of bearing, lrf frame.
    pub beams: Vec<Beam>,
    /// Pose of the robot by its odometry, in the odometry's own frame.
    pub map_from_robot_odometry: Option<Pose2>,
    /// Pose of the laser on the robot, the same for all scans; `None` if nothing tells it.
    pub robot_from_lrf: Option<Pose2>,
    /// Line of the file, or number of a laser's scan, from 1.
    pub line: u64,
}

impl LogScan {
    /// The scan as the core takes it.
    pub fn scan(&self) -> RangeScan<'_> {
        RangeScan { stamp: self.stamp, range_max_m: self.range_max_m, beams: &self.beams }
    }
}

/// Iterator over the scans of a log.
pub struct LogReader {
    file: String,
    size_bytes: u64,
    source: Source,
    format: Option<(LogFormat, Box<dyn LineReader>)>,
    options: LogOptions,
    range_limit: RangeLimit,
    mounting: Mounting,
    beam_count: Option<usize>,
    ahead: VecDeque<Result<RawScan, LogError>>,
    ended: bool,
    scans_read: u64,
    content_lines: u64,
    last_stamp: Option<Instant>,
    stamps: Stamps,
    counts: LogCounts,
}

impl LogReader {
    /// Opens the log at `path` and reads its first scans.
    ///
    /// # Errors
    /// If it cannot be opened, is empty or no log, or has no scan that can be read.
    pub fn open(path: &Path, options: LogOptions) -> Result<Self, LogError> {
        let file = path.display().to_string();
        if let Some((bag, size)) = bag_at(path, &options)? {
            return Self::start(file, Source::Bag(Box::new(bag)), size, options);
        }
        let (lines, size) = Lines::open(path).map_err(|source| LogError::Open { file: file.clone(), source })?;
        Self::start(file, Source::Lines(Box::new(lines)), size, options)
    }

    /// Reads a log from `source`; `name` stands for the file in messages.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn from_reader(name: &str, source: impl Read + Send + 'static, options: LogOptions) -> Result<Self, LogError> {
        let file = name.to_owned();
        let lines = Lines::new(source).map_err(|source| LogError::Open { file: file.clone(), source })?;
        Self::start(file, Source::Lines(Box::new(lines)), 0, options)
    }

    fn start(file: String, source: Source, size_bytes: u64, options: LogOptions) -> Result<Self, LogError> {
        if options.tf.is_any() && matches!(source, Source::Lines(_)) {
            return Err(LogError::NoFrames { file });
        }
        let mut reader = Self {
            file,
            size_bytes,
            source,
            format: None,
            options,
            range_limit: RangeLimit::new(options.range_max_m),
            mounting: Mounting::default(),
            beam_count: None,
            ahead: VecDeque::new(),
            ended: false,
            scans_read: 0,
            content_lines: 0,
            last_stamp: None,
            stamps: Stamps::default(),
            counts: LogCounts::default(),
        };
        while reader.ahead.len() < LOOK_AHEAD && !reader.ended {
            let next = reader.read_scan();
            reader.ahead.extend(next.transpose());
        }
        match reader.ahead.pop_front() {
            Some(Err(error)) => return Err(error),
            Some(first) => reader.ahead.push_front(first),
            None => return Err(reader.no_scan()),
        }
        Ok(reader)
    }

    /// The format; known since a scan has been read.
    pub fn format(&self) -> Option<LogFormat> {
        match &self.source {
            Source::Bag(bag) => Some(bag.format()),
            Source::Lines(_) => self.format.as_ref().map(|(format, _)| *format),
        }
    }

    /// What was found among the frames of a bag, in words.
    pub fn frames_found(&self) -> &[String] {
        match &self.source {
            Source::Bag(bag) => bag.frames_found(),
            Source::Lines(_) => &[],
        }
    }

    /// What was met so far.
    pub fn counts(&self) -> LogCounts {
        LogCounts { ranges: self.range_limit.notes(), ..self.counts.clone() }
    }

    /// Size of the file, bytes; 0 if it is not a file.
    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
    }

    /// Bytes of the file read so far, to watch from elsewhere.
    pub fn bytes_read(&self) -> ByteCount {
        match &self.source {
            Source::Lines(lines) => lines.bytes_read(),
            Source::Bag(bag) => bag.bytes_read(),
        }
    }

    /// SHA-256 of the whole file, hexadecimal; of no file, or of one that cannot be read, of the bytes so far.
    pub fn sha256(&mut self) -> String {
        let lines = match &mut self.source {
            Source::Lines(lines) => lines,
            Source::Bag(bag) => return bag.sha256(),
        };
        if self.size_bytes > 0 {
            // A file that cannot be read further was reported when its lines could not.
            let _ = lines.read_rest();
        }
        lines.sha256()
    }

    /// Ranges from here on are misses, m, as far as the log has shown.
    pub fn range_max_m(&self) -> f32 {
        self.range_limit.range_max_m()
    }

    fn no_scan(&self) -> LogError {
        let (file, lines) = (self.file.clone(), self.line_number());
        if let Some(first) = self.counts.damaged.first().cloned() {
            LogError::AllDamaged { file, damaged: self.counts.damaged_lines, first }
        } else if let Source::Bag(bag) = &self.source {
            bag.no_scan(file)
        } else if self.format.is_some() {
            LogError::NoScan { file, lines }
        } else if self.content_lines == 0 && !self.counts.cut_last_line {
            LogError::Empty { file }
        } else {
            LogError::NotALog { file, lines }
        }
    }

    /// The next scan as it stands in the log; `None` at its end. An error is the last thing handed out.
    fn read_scan(&mut self) -> Result<Option<RawScan>, LogError> {
        let scan = self.next_raw();
        self.ended = !matches!(scan, Ok(Some(_)));
        if let Ok(Some(scan)) = &scan {
            self.learn(scan);
        }
        scan
    }

    fn line_number(&self) -> u64 {
        match &self.source {
            Source::Lines(lines) => lines.line_number(),
            Source::Bag(bag) => bag.number(),
        }
    }

    fn next_raw(&mut self) -> Result<Option<RawScan>, LogError> {
        loop {
            let Source::Lines(lines) = &mut self.source else { return self.next_of_bag() };
            let line = match lines.next_line() {
                Ok(Some(line)) => line,
                Ok(None) => return Ok(None),
                Err(LineFault::TooLong) if self.format.is_some() => {
                    self.skip_long_line()?;
                    continue;
                }
                Err(source) => return Err(self.read_error(source)),
            };
            if line.text.is_empty() || line.text.starts_with('#') {
                continue;
            }
            if line.number == 1 && line.text.starts_with("LRFREC") {
                return Err(LogError::Recording { file: self.file.clone() });
            }
            self.content_lines += 1;
            match read_line(&mut self.format, &line, self.beam_count) {
                Ok(Content::Scan(scan)) => return Ok(Some(*scan)),
                Ok(Content::Other) => {}
                Ok(Content::Unknown) => self.counts.skipped_lines += 1,
                Err(_) if !line.ended => {
                    self.counts.cut_last_line = true;
                    return Ok(None);
                }
                Err(fault) => self.counts.add_damaged(line.number, fault),
            }
            if self.format.is_none() && self.content_lines >= LINES_BEFORE_GIVING_UP {
                return Err(LogError::NotALog { file: self.file.clone(), lines: self.line_number() });
            }
        }
    }

    fn skip_long_line(&mut self) -> Result<(), LogError> {
        let expected = format!("at most {LINE_BYTES_MAX} bytes");
        self.counts.add_damaged(self.line_number(), fault("line".to_owned(), &expected, Some("more")));
        let Source::Lines(lines) = &mut self.source else { return Ok(()) };
        lines.skip_line().map_err(|source| self.read_error(source))
    }

    fn read_error(&self, source: LineFault) -> LogError {
        let (file, line) = (self.file.clone(), self.line_number());
        match source {
            LineFault::TooLong if self.format.is_none() => LogError::NotALog { file, lines: line },
            _ => LogError::Read { file, line, scans: self.scans_read, source },
        }
    }

    /// What a scan tells about the log as a whole.
    fn learn(&mut self, scan: &RawScan) {
        self.beam_count.get_or_insert(scan.ranges_m.len());
        self.scans_read += 1;
        self.range_limit.observe(&scan.ranges_m, self.bearings(scan).step_rad, scan.range_max_m);
        self.mounting.observe(scan);
        let is_told = self.options.field_of_view_rad.is_some() || scan.bearings.is_some();
        self.counts.guessed_angles += u64::from(!is_told && !Bearings::is_usual(scan.ranges_m.len()));
    }

    fn bearings(&self, scan: &RawScan) -> Bearings {
        let beams = scan.ranges_m.len();
        let given = self.options.field_of_view_rad.map(|angle| Bearings::over(angle, beams));
        given.or(scan.bearings).unwrap_or_else(|| Bearings::usual(beams))
    }

    /// The scan with all that the log as a whole says.
    fn finish(&mut self, scan: &RawScan) -> LogScan {
        let measured = self.mounting.robot_from_lrf();
        self.counts.mounting_contradictions += u64::from(self.mounting.contradicted_by(scan));
        let stamp = self.stamp(scan);
        self.counts.backward_times += u64::from(self.last_stamp.is_some_and(|last| stamp < last));
        self.counts.repeated_times += u64::from(!self.stamps.insert(stamp));
        self.last_stamp = Some(stamp);
        self.counts.scans += 1;
        LogScan {
            stamp,
            range_max_m: scan.range_max_m.filter(|_| scan.exact.is_some()).unwrap_or(self.range_limit.range_max_m()),
            beams: scan.beams(self.bearings(scan), self.range_limit.range_max_m()),
            map_from_robot_odometry: scan.odometry_from_robot.map(|pose| pose.to_f32()),
            robot_from_lrf: self.options.robot_from_lrf.or(scan.robot_from_lrf).or(measured),
            line: scan.line,
        }
    }

    fn stamp(&mut self, scan: &RawScan) -> Instant {
        scan.stamp.unwrap_or_else(|| {
            self.counts.synthetic_times = true;
            let micros = self.options.scan_interval.micros;
            Instant::from_micros(micros.saturating_mul(self.counts.scans as i64))
        })
    }
}

/// Lets the format's reader have the line; before the format is known, this line may tell it.
///
/// * `beam_count` — of the first scan
fn read_line(
    format: &mut Option<(LogFormat, Box<dyn LineReader>)>,
    line: &Line<'_>,
    beam_count: Option<usize>,
) -> Result<Content, FieldFault> {
    if format.is_none() {
        *format = LogFormat::of_line(&line.text);
    }
    let Some((_, reader)) = format else { return Ok(Content::Unknown) };
    let content = reader.read(line)?;
    if let Content::Scan(scan) = &content {
        check_beam_count(scan, beam_count)?;
    }
    Ok(content)
}

/// Another number of beams than the first scan's is believed only if it is known where they point.
fn check_beam_count(scan: &RawScan, first: Option<usize>) -> Result<(), FieldFault> {
    let found = scan.ranges_m.len();
    let expected = first.filter(|&first| first != found && scan.bearings.is_none() && !Bearings::is_usual(found));
    expected.map_or(Ok(()), |first| {
        let expected = format!("{first} as in the first scan, or angles in the line");
        Err(fault("number of beams".to_owned(), &expected, Some(&found.to_string())))
    })
}

impl Iterator for LogReader {
    type Item = Result<LogScan, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let ahead = self.ahead.pop_front();
        let next = ahead.or_else(|| if self.ended { None } else { self.read_scan().transpose() });
        next.map(|scan| scan.map(|raw| self.finish(&raw)))
    }
}

impl std::iter::FusedIterator for LogReader {}

#[cfg(test)]
mod tests;
