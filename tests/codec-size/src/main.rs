//! What one driver of a laser range finder costs on a Cortex-M4F: a program with nothing but it. See `measure`.
#![no_std]
#![no_main]

use lrfslam_lrf::driver::{Input, LrfDriver, Output};
use lrfslam_scan::Beam;
use lrfslam_scan::time::Instant;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

#[cfg_attr(not(any(feature = "hokuyo", feature = "sick", feature = "rplidar", feature = "ldrobot")), allow(dead_code))]
/// Feeds a port's bytes to the driver for ever. The port is an address, so that nothing can be computed beforehand.
fn serve(driver: &mut dyn LrfDriver, port: *mut u8) -> ! {
    let mut micros = 0;
    loop {
        micros += 100;
        // SAFETY: never run, only measured.
        let byte = unsafe { port.read_volatile() };
        let input = if byte == 0 { Input::Timeout } else { Input::Bytes(core::slice::from_ref(&byte)) };
        let taken = driver.handle_input(Instant::from_micros(micros), input);
        while !matches!(driver.poll_output(), Output::Timeout(_)) {
            // SAFETY: never run, only measured.
            unsafe { port.write_volatile(taken as u8) };
        }
    }
}

/// Where a microcontroller would start.
#[unsafe(no_mangle)]
pub extern "C" fn _start(port: *mut u8, beams: &'static mut [Beam; 1081], bytes: &'static mut [u8; 7168]) -> ! {
    let _ = (&beams, &bytes);
    #[cfg(feature = "hokuyo")]
    serve(&mut lrfslam_lrf::hokuyo_scip::HokuyoDriver::new(Default::default(), bytes, beams), port);
    #[cfg(feature = "sick")]
    serve(&mut lrfslam_lrf::sick_lms::SickDriver::new(Default::default(), bytes, beams), port);
    #[cfg(feature = "rplidar")]
    serve(&mut lrfslam_lrf::rplidar::RplidarDriver::new(Default::default(), beams), port);
    #[cfg(feature = "ldrobot")]
    serve(&mut lrfslam_lrf::ldrobot::LdrobotDriver::new(Default::default(), beams), port);
    #[allow(unreachable_code)]
    loop {
        // SAFETY: never run, only measured.
        unsafe { port.write_volatile(0) };
    }
}
