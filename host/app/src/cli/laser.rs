//! What the commands with a laser share: its arguments, ctrl-C, and words on the way.

use std::ffi::OsStr;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Arg, Args, Command};
use lrfslam_lrf::sick_lms::Variant;

use super::ros2::topic;
use super::shared::{LRF, PORT, SECONDS, seconds, within};
use super::{Failure, ros2_node};
use crate::held;
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_host::scans::link::Address;
use lrfslam_host::scans::live::{LiveLaser, NoLaser, Say};

/// `--lrf`.
#[derive(Debug, Clone, Copy)]
enum LrfChoice {
    /// To be found out.
    Any,
    Family(LrfFamily),
    /// Scans that others publish in ROS 2.
    Topic(&'static str),
}

/// Reads it: a name, or `ros2:` and a topic.
#[derive(Debug, Clone, Copy)]
struct LrfParser;

/// What a topic begins with.
const ROS2: &str = "ros2:";

impl TypedValueParser for LrfParser {
    type Value = LrfChoice;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<LrfChoice, clap::Error> {
        if let Some(name) = value.to_str().and_then(|text| text.strip_prefix(ROS2)) {
            let wrong = |error| command.clone().error(ErrorKind::ValueValidation, format!("--lrf: {error}"));
            return topic(name).map(LrfChoice::Topic).map_err(wrong);
        }
        let names = PossibleValuesParser::new(self.possible_values().into_iter().flatten());
        let name = names.parse_ref(command, arg, value)?;
        let family = LrfFamily::ALL.into_iter().find(|family| family.names().flag == name);
        Ok(family.map_or(LrfChoice::Any, LrfChoice::Family))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let auto = PossibleValue::new("auto").help("Found out, with its rate, within 30 s; it is said which it is");
        let known = |family: LrfFamily| PossibleValue::new(family.names().flag).help(family.names().models);
        let told = PossibleValue::new("ros2:TOPIC")
            .help("Scans that others publish in ROS 2, such as ros2:/scan; without --port");
        Some(Box::new([auto].into_iter().chain(LrfFamily::ALL.map(known)).chain([told])))
    }
}

/// Which laser, and how it is reached.
#[derive(Debug, Args)]
pub(super) struct LaserArgs {
    #[arg(long, value_parser = LrfParser, help = LRF)]
    lrf: LrfChoice,
    #[arg(long, value_name = "DEV", help = PORT)]
    port: Option<Address>,
    /// Rate to change to, bit/s; auto finds the sensor's, and raises a slow one to what every port can.
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = parse_baud)]
    baud: u32,
    /// SICK: field of view and resolution in degrees, such as 180/0.5 [default: as it is].
    #[arg(long, value_name = "VIEW/STEP", value_parser = parse_variant)]
    variant: Option<(u16, u16)>,
    /// SICK below 1 degree: whole, interlaced scans instead of one scan per mirror turn.
    #[arg(long)]
    whole_scans: bool,
    /// SICK: set it to tell how bright echoes are, so that reflectors can be found; the change stays in the sensor.
    #[arg(long)]
    brightness: bool,
    /// Hokuyo: merge so many neighbouring steps into one beam.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=99))]
    cluster: u8,
    /// Known delay of the link, subtracted from every time stamp, milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = milliseconds)]
    latency: f64,
    /// Wait as long as it takes for what is to be at the port.
    ///
    /// Otherwise a port that cannot be opened is given up after 10 s, and so is a laser that does not answer; before that it is
    /// found out whether another one is there, up to 20 s in all, and a SICK, which boots for 15 s, is asked for 10 s more. One
    /// that answers must scan within 20 s. After the first scan a laser is always waited for.
    #[arg(long)]
    wait: bool,
}

/// When a live run ends by itself.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct EndArgs {
    /// End after so many scans.
    #[arg(long, value_name = "N")]
    scans: Option<usize>,
    #[arg(long, value_name = "S", help = SECONDS, value_parser = seconds)]
    seconds: Option<f64>,
}

impl EndArgs {
    /// The same, with an end after `seconds` if there is none.
    pub(super) fn or_seconds(self, seconds: f64) -> Self {
        if self.has_end() { self } else { Self { seconds: Some(seconds), ..self } }
    }

    /// It ends by itself.
    pub(super) fn has_end(self) -> bool {
        self.scans.is_some() || self.seconds.is_some()
    }

    /// So many scans over so many seconds are enough.
    pub(super) fn is_reached(self, scans: usize, seconds: f64) -> bool {
        self.scans.is_some_and(|enough| scans >= enough) || self.seconds.is_some_and(|enough| seconds >= enough)
    }
}

fn milliseconds(text: &str) -> Result<f64, String> {
    within(text, 0.0, 10_000.0)
}

pub(super) fn parse_baud(text: &str) -> Result<u32, String> {
    if text == "auto" {
        return Ok(0);
    }
    let rate = text.parse().ok().filter(|rate| (9_600..=3_000_000).contains(rate));
    rate.ok_or_else(|| "expected auto, or a rate such as 38400".to_owned())
}

fn parse_variant(text: &str) -> Result<(u16, u16), String> {
    let expected = "expected 180/1, 180/0.5, 100/1, 100/0.5 or 100/0.25";
    let (view, step) = text.split_once('/').ok_or(expected)?;
    let angle_deg = view.parse().map_err(|_| expected)?;
    let step: f64 = step.parse().map_err(|_| expected)?;
    let variant = Variant { angle_deg, resolution_cdeg: (step * 100.0).round() as u16 };
    if variant.is_possible() { Ok((variant.angle_deg, variant.resolution_cdeg)) } else { Err(expected.to_owned()) }
}

/// A rate that lasers of the family do not have would be as if nothing had been said, or worse.
fn check_baud(family: LrfFamily, baud: u32) -> Result<(), String> {
    if baud == 0 || family.rates().contains(&baud) {
        return Ok(());
    }
    let rates: Vec<String> = family.rates().iter().map(u32::to_string).collect();
    Err(format!("{} {family} does not have {baud} baud, only {}", family.names().article, rates.join(", ")))
}

impl LaserArgs {
    /// The topic of ROS 2 that takes the place of a laser.
    pub(super) fn topic(&self) -> Option<&'static str> {
        if let LrfChoice::Topic(topic) = self.lrf { Some(topic) } else { None }
    }

    /// Where the scans come from, as the user said it.
    pub(super) fn name(&self) -> String {
        let port = self.port.as_ref().map(Address::to_string);
        self.topic().map(|topic| format!("{ROS2}{topic}")).or(port).unwrap_or_default()
    }

    /// The scans of it, not recorded.
    ///
    /// * `range_max_m` — ranges from here on are misses, m; `None`: as the laser, or the topic's messages, say
    pub(super) fn scans(
        &self,
        range_max_m: Option<f32>,
        stop: &'static AtomicBool,
        say: Say,
    ) -> Result<Scans, Failure> {
        match self.topic() {
            Some(topic) => ros2_node::scans(topic, (range_max_m, self.wait), stop, say),
            None => Ok(Scans::live(self.live().map_err(Failure::Start)?, stop, say).within(range_max_m)),
        }
    }

    /// The laser at a port that is meant; not recorded.
    pub(super) fn live(&self) -> anyhow::Result<LiveLaser> {
        let family = match self.lrf {
            LrfChoice::Any => None,
            LrfChoice::Family(family) => Some(family),
            LrfChoice::Topic(_) => {
                anyhow::bail!("{}: expected a laser at a port: this command takes no topic", self.name())
            }
        };
        let port = self.port.as_ref().context("--port is missing: where the laser is plugged in")?;
        if family == Some(LrfFamily::SickLms2xx) {
            anyhow::ensure!(
                port.has_baud(),
                "a SICK LMS2xx cannot be reached over TCP or UDP: its rate must be changed, and a serial-to-network converter keeps its \
                 own; connect it to a serial port"
            );
        }
        family.map_or(Ok(()), |family| check_baud(family, self.baud)).map_err(anyhow::Error::msg)?;
        let any_family = family.is_none();
        anyhow::ensure!(!any_family || self.baud == 0, "--lrf auto finds the rate itself: --baud needs a laser's name");
        let options = LrfOptions {
            baud: self.baud,
            has_baud: port.has_baud(),
            variant: self.variant,
            whole_scans: self.whole_scans,
            brightness: self.brightness,
            cluster: self.cluster,
            latency_us: (self.latency * 1000.0) as i64,
            ..LrfOptions::new(family.unwrap_or(LrfFamily::Hokuyo))
        };
        Ok(LiveLaser { any_family, waits: self.wait, ..LiveLaser::new(port.clone(), options) })
    }
}

/// A source of scans that ended with an error: a laser that is not there is a fault on the way, the rest is wrong from the start.
pub(super) fn source_failure(error: anyhow::Error) -> Failure {
    if error.is::<NoLaser>() { Failure::Work(error) } else { Failure::Start(error) }
}

/// A flag that ctrl-C sets; a second one ends the program at once, whose results are whole at any moment.
pub fn interrupt_flag() -> anyhow::Result<&'static AtomicBool> {
    static STOP: AtomicBool = AtomicBool::new(false);
    static ONCE: Once = Once::new();
    let mut caught = Ok(());
    let stop = || {
        if STOP.swap(true, Ordering::Relaxed) {
            held::release();
            std::process::exit(130);
        }
    };
    ONCE.call_once(|| caught = ctrlc::set_handler(stop));
    caught.context("ctrl-C cannot be caught")?;
    Ok(&STOP)
}

/// Words for the user, on standard error.
pub(super) fn say(text: &str) {
    held::say(text);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_that_a_laser_does_not_have_are_refused() {
        use LrfFamily::{Hokuyo, Ld06, Rplidar, SickLms2xx};
        for (family, baud) in
            [(Hokuyo, 0), (Hokuyo, 115_200), (SickLms2xx, 500_000), (Rplidar, 256_000), (Ld06, 230_400)]
        {
            assert_eq!(check_baud(family, baud), Ok(()));
        }
        for (family, baud) in [(Hokuyo, 9_600), (SickLms2xx, 115_200), (Rplidar, 9_600)] {
            assert!(check_baud(family, baud).is_err(), "{family} {baud}");
        }
        assert_eq!(check_baud(Ld06, 115_200), Err("an LD06 does not have 115200 baud, only 230400".to_owned()));
    }

    #[test]
    fn wrong_arguments_are_refused_in_words() {
        assert_eq!(parse_baud("auto"), Ok(0));
        assert_eq!(parse_baud("38400"), Ok(38_400));
        assert!(parse_baud("fast").is_err() && parse_baud("12").is_err());
        assert_eq!(parse_variant("100/0.25"), Ok((100, 25)));
        assert!(parse_variant("180/0.25").is_err() && parse_variant("180").is_err());
    }
}
