//! RPLIDAR and LDROBOT: any bytes, cut anywhere, through decoders.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lrfslam_lrf::ldrobot::PacketDecoder;
use lrfslam_lrf::rplidar::RplidarDecoder;

fn ldrobot_packets(bytes: &[u8], piece: usize) -> usize {
    let mut decoder = PacketDecoder::default();
    let mut packets = 0;
    for mut rest in bytes.chunks(piece) {
        while !rest.is_empty() {
            let (taken, packet) = decoder.feed(rest);
            assert!(taken > 0, "no progress");
            packets += usize::from(packet.is_some());
            rest = &rest[taken..];
        }
    }
    packets
}

fn rplidar_events(bytes: &[u8], piece: usize) -> usize {
    let mut decoder = RplidarDecoder::default();
    let mut events = 0;
    for mut rest in bytes.chunks(piece) {
        loop {
            let (taken, event) = decoder.feed(rest);
            let quiet = event.is_none();
            events += usize::from(!quiet);
            rest = &rest[taken..];
            if quiet && rest.is_empty() {
                break;
            }
        }
    }
    events
}

fuzz_target!(|input: &[u8]| {
    let Some((how, bytes)) = input.split_first() else { return };
    let piece = usize::from(how >> 2) + 1;
    assert_eq!(ldrobot_packets(bytes, piece), ldrobot_packets(bytes, bytes.len().max(1)), "the cut matters");
    assert_eq!(rplidar_events(bytes, piece), rplidar_events(bytes, bytes.len().max(1)), "the cut matters");
});
