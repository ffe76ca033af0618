//! Throughput of the decoders, bytes to beams: `cargo bench -p lrfslam-tests --bench decoders`

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use lrfslam_core::scan::Beam;
use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_firmware_sim::virtual_lrf::sick::{SickModel, VirtualSick};
use lrfslam_lrf::hokuyo_scip::scan::read_scan;
use lrfslam_lrf::hokuyo_scip::{Command, Reply, ScipDecoder};
use lrfslam_lrf::ldrobot::{Packet, PacketDecoder, Point};
use lrfslam_lrf::rplidar::response::{Descriptor, ResponseKind};
use lrfslam_lrf::rplidar::{Capsule, DecoderEvent as RplidarEvent, RplidarDecoder};
use lrfslam_lrf::sick_lms::measurement::ValueFormat;
use lrfslam_lrf::sick_lms::scan::ScanLayout;
use lrfslam_lrf::sick_lms::telegram::{Direction, MAX_TELEGRAM};
use lrfslam_lrf::sick_lms::{self, DecoderEvent, OperatingMode, ReplyBody, TelegramDecoder, Variant};

fn main() {
    divan::main();
}

/// What `device` sends in ten seconds.
fn stream(device: &mut dyn VirtualLrf) -> Vec<u8> {
    let mut bytes = Vec::new();
    let end = Instant::from_micros(10_000_000);
    while device.deadline() < end {
        let now = device.deadline();
        device.timeout(now);
        while let Some(emission) = device.poll() {
            bytes.extend(emission.bytes);
        }
    }
    bytes
}

/// UTM-30LX, 1081 values of three characters.
#[divan::bench]
fn hokuyo_scip(bencher: Bencher<'_, '_>) {
    let model = HokuyoModel::utm_30lx();
    let sensor = model.parameters.clone();
    let mut device =
        VirtualHokuyo::new(model, Box::new(Scenario::load("room").expect("comes with the program").scene()), 1);
    device.receive(Instant::default(), b"MD0000108001000\n");
    let bytes = stream(&mut device);
    let Ok(Command::Stream { acquire, .. }) = Command::parse(b"MD0000108001000") else { return };
    bencher.counter(BytesCount::of_slice(&bytes)).bench_local(|| {
        let (mut memory, mut beams) = ([0; 7168], [Beam::BLANK; 1081]);
        let mut decoder = ScipDecoder::new(&mut memory);
        let mut rest = &bytes[..];
        let mut scans = 0;
        while !rest.is_empty() {
            let (taken, frame) = decoder.feed(rest);
            rest = &rest[taken..];
            let reply = frame.and_then(|frame| Reply::find(frame, b"MD", 15).ok());
            scans += usize::from(reply.is_some_and(|reply| read_scan(&reply, &sensor, &acquire, &mut beams).is_ok()));
        }
        assert!(scans > 390);
        black_box(beams[500])
    });
}

/// LMS200, 361 values.
#[divan::bench]
fn sick_lms(bencher: Bencher<'_, '_>) {
    let mut device = VirtualSick::new(
        SickModel::lms200(),
        Box::new(Scenario::load("room").expect("comes with the program").scene()),
        1,
    );
    device.set_baud(500_000);
    device.set_mode(OperatingMode::StreamAll);
    let bytes = stream(&mut device);
    let format = ValueFormat { mask: 0x1FFF };
    let layout = ScanLayout { variant: Variant::DEG_180_BY_HALF, format };
    bencher.counter(BytesCount::of_slice(&bytes)).bench_local(|| {
        let (mut memory, mut beams) = ([0; MAX_TELEGRAM], [Beam::BLANK; 401]);
        let mut decoder = TelegramDecoder::new(Direction::ToHost, &mut memory);
        let mut rest = &bytes[..];
        let mut scans = 0;
        loop {
            let (taken, event) = decoder.feed(rest);
            rest = &rest[taken..];
            let Some(DecoderEvent::Telegram(payload)) = event else { break };
            let Some(ReplyBody::Scan(scan)) = sick_lms::Reply::parse(payload).map(|reply| reply.body) else { continue };
            scans += usize::from(layout.read(&scan, &mut beams).is_ok());
        }
        assert!(scans > 370);
        black_box(beams[180])
    });
}

/// LD06, twelve samples a packet.
#[divan::bench]
fn ldrobot(bencher: Bencher<'_, '_>) {
    let packet = |index: u16| {
        let points = [Point { distance_mm: 1000 + index, intensity: 200 }; 12];
        let start_cdeg = index * 960 % 36_000;
        Packet { speed_degps: 3600, start_cdeg, points, end_cdeg: (start_cdeg + 880) % 36_000, stamp_ms: index }.emit()
    };
    let bytes: Vec<u8> = (0..1000).flat_map(packet).collect();
    bencher.counter(BytesCount::of_slice(&bytes)).bench_local(|| {
        let mut decoder = PacketDecoder::default();
        let (mut rest, mut packets) = (&bytes[..], 0);
        while !rest.is_empty() {
            let (taken, packet) = decoder.feed(rest);
            rest = &rest[taken..];
            packets += usize::from(packet.is_some());
        }
        assert_eq!(packets, 1000);
    });
}

/// RPLIDAR, dense express packets, with their samples.
#[divan::bench]
fn rplidar(bencher: Bencher<'_, '_>) {
    let mut bytes = Descriptor { kind: ResponseKind::DenseCapsule }.emit().to_vec();
    for index in 0..1000 {
        bytes.extend(Capsule::build(true, index == 0, (index * 36 % 360) as f32, &[1000; 40]).bytes());
    }
    bencher.counter(BytesCount::of_slice(&bytes)).bench_local(|| {
        let mut decoder = RplidarDecoder::default();
        let (mut rest, mut samples, mut previous) = (&bytes[..], 0, None);
        loop {
            let (taken, event) = decoder.feed(rest);
            rest = &rest[taken..];
            match event {
                Some(RplidarEvent::Capsule(capsule)) => {
                    let before = previous.replace(capsule.clone());
                    samples += before.map_or(0, |before: Capsule| before.samples(&capsule).len());
                }
                Some(_) => {}
                None => break,
            }
        }
        assert_eq!(samples, 999 * 40);
    });
}
