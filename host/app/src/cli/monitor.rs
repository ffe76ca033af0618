//! `--monitor`, `--zenoh` and `--tui`: a run is watched while it works.

use std::cell::RefCell;
use std::io::IsTerminal as _;
use std::net::SocketAddr;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;
use clap::Args;
use lrfslam_host::maps::occupancy::MapConfig;
use lrfslam_host::monitor::{About, Feed, Monitor};
use lrfslam_host::scans::live::Say;

use super::live_page::{parse_address, serve};
use super::shared::TellArgs;
use super::zenoh::{self, Place, parse_place};
use super::{Failure, not_built_in};
use crate::tui::{self, Screen};

/// A live page.
#[derive(Debug, Clone, Args)]
pub struct MonitorArgs {
    /// Serve a live page of the run; open the link that is printed. ADDR is an address or port of this computer.
    ///
    /// Without ADDR, this computer alone sees it, at port 7340 or another that is free. At an address that others reach, such as
    /// 0.0.0.0, the link holds a token, and who does not have it sees nothing. Whoever has it may pause, save and stop. The
    /// environment's LRFSLAM_TOKEN is taken as the token, if there is one.
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = "", value_parser = parse_address)]
    monitor: Option<SocketAddr>,
    /// After the end, keep the page, and what is told in Zenoh, until ctrl-C.
    #[arg(long)]
    monitor_stay: bool,
    /// Tell in Zenoh how the run goes, for `lrfslam watch zenoh:PLACE`. PLACE is HOST[:PORT] of a router, or listen:IP[:PORT].
    ///
    /// Whoever is in that Zenoh sees the run; nobody commands it there.
    #[arg(long, value_name = "PLACE", value_parser = parse_place)]
    zenoh: Option<Place>,
    /// The robot's name in Zenoh [default: that of this computer].
    #[arg(long, value_name = "NAME", requires = "zenoh")]
    zenoh_name: Option<String>,
    /// Watch in this terminal, as over ssh: map, robot, path and how things stand, with keys to pause, save and stop.
    ///
    /// What is said meanwhile comes when the view is left.
    #[arg(long)]
    tui: bool,
}

impl MonitorArgs {
    /// What the run is to be watched by, if it is to be.
    ///
    /// * `what` and `source` — the command, and where its scans come from; `frame` — see [`About::frame`]
    pub(super) fn watched(
        &self,
        (what, source, frame): (&str, String, Option<String>),
        map: MapConfig,
        stop: &'static AtomicBool,
    ) -> Result<Watched, Failure> {
        if self.tui {
            ensure_terminal()?;
        }
        if self.monitor_stay && self.monitor.is_none() && self.zenoh.is_none() {
            return Err(Failure::Start(anyhow::anyhow!("--monitor-stay needs --monitor or --zenoh")));
        }
        if self.monitor.is_none() && self.zenoh.is_none() && !self.tui {
            return Ok(Watched::nobody(stop));
        }
        let about = About { what: what.to_owned(), source: source.clone(), frame, map };
        let (monitor, feed) = Monitor::start(about, stop).map_err(Failure::work)?;
        let name = source.rsplit('/').next().unwrap_or_default().to_owned();
        Ok(Watched {
            page: Some(Page {
                address: self.monitor,
                has_screen: self.tui,
                screen: RefCell::default(),
                zenoh: self.zenoh.clone().map(|place| (place, self.zenoh_name.clone().unwrap_or_else(computer))),
                name,
                monitor,
                feed,
                stays: self.monitor_stay,
            }),
            stop,
        })
    }
}

/// The name of this computer, as far as a key can be made of it.
fn computer() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = if name.trim().is_empty() { std::env::var("COMPUTERNAME").unwrap_or_default() } else { name };
    let name: String = name.trim().chars().filter(|c| c.is_alphanumeric() || "-_.".contains(*c)).collect();
    if name.is_empty() { "robot".to_owned() } else { name }
}

/// A view of the terminal needs one, and is told of keys.
fn ensure_terminal() -> Result<(), Failure> {
    if !tui::IS_BUILT_IN {
        return Err(not_built_in("terminal view", "tui"));
    }
    if std::io::stderr().is_terminal() && std::io::stdin().is_terminal() {
        return Ok(());
    }
    let why = "--tui needs a terminal, at standard input and standard error: this is a pipe or a file";
    Err(Failure::Start(anyhow::anyhow!(why)))
}

/// A run that may be watched; without `--monitor`, `--zenoh` and `--tui` all of this does nothing.
pub(super) struct Watched {
    page: Option<Page>,
    stop: &'static AtomicBool,
}

struct Page {
    address: Option<SocketAddr>,
    has_screen: bool,
    /// The view in the terminal, while it is there.
    screen: RefCell<Option<Screen>>,
    /// Where in Zenoh, and as what, it is told.
    zenoh: Option<(Place, String)>,
    name: String,
    monitor: Monitor,
    feed: Feed,
    stays: bool,
}

impl Watched {
    /// One that nobody watches.
    pub(super) fn nobody(stop: &'static AtomicBool) -> Self {
        Self { page: None, stop }
    }

    /// Serves the page, and says where; or shows the run in the terminal.
    ///
    /// * `can_pause` — the scans wait when the run does
    pub(super) fn open(&self, can_pause: bool, tell: TellArgs) -> Result<(), Failure> {
        let Some(page) = &self.page else { return Ok(()) };
        page.monitor.set_can_pause(can_pause);
        if let Some(address) = page.address {
            serve(address, (&page.name, page.monitor.clone()), tell)?;
        }
        if let Some((place, name)) = &page.zenoh {
            zenoh::tell(place, name, &page.monitor)?;
            tell.say(&format!("in Zenoh: {name}"));
        }
        if page.has_screen {
            let screen = Screen::open(&page.monitor).context("--tui: this terminal cannot be drawn on");
            page.screen.replace(Some(screen.map_err(Failure::Start)?));
        }
        Ok(())
    }

    /// Words on the way, for those who watch too.
    pub(super) fn sayer(&self, tell: TellArgs) -> Say {
        let monitor = self.page.as_ref().map(|page| page.monitor.clone());
        Box::new(move |text| {
            tell.say(text);
            monitor.iter().for_each(|monitor| monitor.tell(text));
        })
    }

    /// Calls `show` if somebody looks.
    pub(super) fn show(&mut self, show: impl FnOnce(&mut Feed)) {
        if let Some(page) = self.page.as_mut().filter(|page| page.feed.is_wanted()) {
            show(&mut page.feed);
        }
    }

    /// Waits while somebody wants a pause; `show` is called when the state is wanted.
    pub(super) fn pause(&mut self, show: impl FnMut(&mut Feed)) {
        if let Some(page) = &mut self.page {
            page.feed.pause(self.stop, show);
        }
    }

    /// Of the run that begins now, nothing was shown yet.
    pub(super) fn begin_anew(&mut self) {
        self.page.iter_mut().for_each(|page| page.feed.begin_anew());
    }

    /// Words on the way, to those who watch.
    pub(super) fn tell(&self, text: &str) {
        self.page.iter().for_each(|page| page.monitor.tell(text));
    }

    /// The run's end of it, if it is watched.
    #[cfg(feature = "demo")]
    pub(super) fn feed(&mut self) -> Option<&mut Feed> {
        self.page.as_mut().map(|page| &mut page.feed)
    }

    /// Somebody wants the results now.
    pub(super) fn is_asked_to_save(&self) -> bool {
        self.page.as_ref().is_some_and(|page| page.feed.is_asked_to_save())
    }

    /// Lets those who look see the end, and stays for others if that is wanted.
    pub(super) fn finish(&mut self, words: &str, show: impl FnMut(&mut Feed)) {
        let Some(page) = &mut self.page else { return };
        page.feed.finish(words, page.stays.then_some(self.stop), show);
        page.screen.take();
    }
}
