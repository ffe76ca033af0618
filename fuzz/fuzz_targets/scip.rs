//! SCIP: any bytes, cut anywhere, through decoder, reply, parameters and scan; and any line as a command.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::Duration;
use lrfslam_lrf::hokuyo_scip::command::split_tag;
use lrfslam_lrf::hokuyo_scip::scan::read_scan;
use lrfslam_lrf::hokuyo_scip::{Command, Reply, ScipDecoder, SensorParameters};

/// All frames of `bytes`, in pieces of `piece`.
fn frames(bytes: &[u8], piece: usize) -> Vec<Vec<u8>> {
    let mut memory = [0; 512];
    let mut decoder = ScipDecoder::new(&mut memory);
    let mut frames = Vec::new();
    for mut rest in bytes.chunks(piece) {
        while !rest.is_empty() {
            let (taken, frame) = decoder.feed(rest);
            assert!(taken > 0, "no progress");
            frames.extend(frame.map(<[u8]>::to_vec));
            rest = &rest[taken..];
        }
    }
    frames
}

fuzz_target!(init: lrfslam_tests::samples::write("scip", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/scip")), |input: &[u8]| {
    let Some((piece, bytes)) = input.split_first() else { return };
    let found = frames(bytes, usize::from(*piece % 64) + 1);
    assert_eq!(found, frames(bytes, bytes.len().max(1)), "the cut matters");
    let mut beams = [Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Invalid }; 64];
    let mut sensor = None;
    for frame in &found {
        let Ok(reply) = Reply::parse(frame) else { continue };
        let _ = Reply::find(frame, b"QT", 2);
        assert!(reply.info().count() <= frame.len());
        sensor = SensorParameters::parse(&reply).or(sensor);
        let command = split_tag(reply.echo).and_then(|(line, _)| Command::parse(line));
        if let Ok(command) = command {
            assert_eq!(Command::parse(&command.emit()), Ok(command));
        }
        if let (Some(sensor), Ok(Command::Get(acquire) | Command::Stream { acquire, .. })) = (&sensor, command) {
            if let Ok(header) = read_scan(&reply, sensor, &acquire, &mut beams) {
                assert!(header.beams <= beams.len());
                assert!(beams[..header.beams].iter().all(|beam| beam.bearing_rad.is_finite()));
            }
        }
    }
});
