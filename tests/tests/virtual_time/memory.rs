//! What a driver costs in memory, on this machine (pointers of 8 bytes; a microcontroller's are 4): its own size, which is
//! static, and what it borrows. `cargo test -p lrfslam-tests --test virtual_time memory -- --nocapture`

use std::mem::size_of;

use lrfslam_core::scan::Beam;
use lrfslam_lrf::hokuyo_scip::{HokuyoDriver, driver as hokuyo};
use lrfslam_lrf::ldrobot::{LdrobotDriver, driver as ldrobot};
use lrfslam_lrf::rplidar::{RplidarDriver, driver as rplidar};
use lrfslam_lrf::sick_lms::{SickDriver, driver as sick};

#[test]
fn drivers_keep_their_memory_budget() {
    let beam = size_of::<Beam>();
    let rows = [
        ("sick_lms", size_of::<SickDriver<'_>>(), sick::TELEGRAM_MEMORY, sick::BEAM_MEMORY * beam),
        ("hokuyo_scip, URG-04LX", size_of::<HokuyoDriver<'_>>(), 2300, 682 * beam),
        ("hokuyo_scip, UTM-30LX", size_of::<HokuyoDriver<'_>>(), hokuyo::FRAME_MEMORY, hokuyo::BEAM_MEMORY * beam),
        ("rplidar", size_of::<RplidarDriver<'_>>(), 0, rplidar::BEAM_MEMORY * beam),
        ("ldrobot", size_of::<LdrobotDriver<'_>>(), 0, ldrobot::BEAM_MEMORY * beam),
    ];
    for (name, own, bytes, beams) in rows {
        println!("{name}: driver {own} bytes, lent for bytes {bytes}, lent for beams {beams}");
        assert!(own < 4096, "{name}: {own}");
    }
}
