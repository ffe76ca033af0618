//! Everything that decides what a robot does: with the same scans it then does the same.

use serde::{Deserialize, Serialize};

use lrfslam_core::config::{Layout, NO_LAYOUT, Section, layout_with_part};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::slam::SlamConfig;

lrfslam_core::config_choice! {
    /// Which laser is plugged in.
    pub enum LaserFamily {
        /// Hokuyo with SCIP.
        Hokuyo = "hokuyo",
        /// SICK LMS2xx.
        Sick = "sick-lms2xx",
    }
    choices "\"hokuyo\" or \"sick-lms2xx\""
}

lrfslam_core::config! {
    /// The laser and its line.
    pub struct LaserConfig {
        /// Which driver.
        family: LaserFamily = LaserFamily::Hokuyo;
        /// Rate to change to if the laser is slower, one that its family knows, bit/s; 0 keeps the one found.
        baud: u32 = 0;
        /// Hokuyo: neighbouring steps merged, 1 to 99; 0 is 1.
        cluster: u8 = 0, in 0..=99;
    }
}

lrfslam_core::config! {
    /// What a robot that does the SLAM itself tells its host.
    pub struct ReportConfig {
        /// A scan is told with its beams if the robot has moved so far since the last one told, m …
        sweep_distance_m: f32 = 0.05, in 0.0..=10.0;
        /// … or turned so far, degrees. Closing of loops and the drawn map live on these; a beam costs a byte or two on the link.
        sweep_rotation_deg: f32 = 2.0, in 0.0..=180.0;
    }
}

/// The configuration of a robot with all its parts: what a host gives it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RobotConfig {
    /// Of all random numbers.
    pub seed: u64,
    /// Where the laser sits on the robot.
    pub robot_from_lrf: Pose2,
    /// The laser.
    pub laser: LaserConfig,
    /// What is made of its scans.
    pub slam: SlamConfig,
    /// What the host is told.
    pub report: ReportConfig,
}

impl Layout for RobotConfig {
    const LAYOUT: u32 = {
        let layout = layout_with_part(NO_LAYOUT, "seed", u64::LAYOUT);
        let layout = layout_with_part(layout, "robot_from_lrf", Pose2::LAYOUT);
        let layout = layout_with_part(layout, "laser", LaserConfig::LAYOUT);
        layout_with_part(SlamConfig::layout_after(layout), "report", ReportConfig::LAYOUT)
    };
}

impl Default for RobotConfig {
    /// What fits a microcontroller; see [`SlamConfig::small`].
    fn default() -> Self {
        let (laser, report) = (LaserConfig::default(), ReportConfig::default());
        Self { seed: 1, robot_from_lrf: Pose2::IDENTITY, laser, slam: SlamConfig::small(), report }
    }
}

impl RobotConfig {
    /// Section and name of the first field that is out of its bounds.
    pub fn out_of_bounds(&self) -> Option<(&'static str, &'static str)> {
        let laser = self.laser.out_of_bounds().map(|field| ("laser", field));
        let report = || self.report.out_of_bounds().map(|field| ("report", field));
        laser.or_else(|| self.slam.out_of_bounds()).or_else(report)
    }

    /// Calls `visit` with the name of every section and with the section, in order.
    pub fn visit_sections(&self, visit: &mut dyn FnMut(&'static str, &dyn Section)) {
        // A further part is told here, and in the layout above.
        let Self { seed: _, robot_from_lrf: _, laser, slam, report } = self;
        visit("laser", laser);
        slam.visit_sections(visit);
        visit("report", report);
    }
}
