//! `map.png`, for people: the map, the robot's path coloured by time, start and end, a scale bar, a clock and a legend.
//!
//! Data flow: [`Raster`] → canvas (enlarged if small) → path, marks, legend → PNG. Colours run from blue (start) over
//! green to red (end), dark enough to stand out on white.

mod canvas;
mod cloud;
mod glyphs;
mod landmarks;
mod legend;
mod scan;

use std::io;
use std::path::Path;

use anyhow::Context as _;
use lrfslam_core::geometry::Point2;

pub use self::cloud::{CloudView, cloud_png};
pub use self::landmarks::{LandmarkScene, landmarks_png};
pub use self::scan::scan_png;

use self::canvas::{Canvas, Rgb};
use self::legend::draw_legend;
use crate::maps::colours::colour_at;
use crate::maps::contradictions::CELL_M;
use crate::maps::occupancy::{Occupancy, Raster};
use crate::output::{cannot_write, save_file};
use crate::plural::count;
use crate::trajectory::TimedPose;

const FREE: Rgb = [255, 255, 255];
const UNKNOWN: Rgb = [226, 230, 235];
const OCCUPIED: Rgb = [28, 34, 43];
const TRUTH: Rgb = [250, 205, 120];
const CONTRADICTED: Rgb = [214, 40, 190];
const START: Rgb = [22, 130, 60];
const END: Rgb = [200, 28, 40];

/// A smaller map is enlarged until its longer side is at least this, pixels.
const SIDE_MIN: usize = 1000;
const MARGIN: usize = 16;
const FOOTER: usize = 80;
/// From the footer's top to the middle of its first row, which has scale bar and clock, and of its second, the legend.
const FOOTER_ROWS: [usize; 2] = [24, 56];
/// Narrower images cannot hold the legend.
const WIDTH_MIN: usize = 720;

/// What a picture tells besides map and path.
#[derive(Debug, Clone, Copy)]
pub struct PictureNotes<'a> {
    /// The true path, drawn as a broad pale line under the other; empty if it is not known.
    pub truth: &'a [TimedPose],
    /// The poses' times were measured. If they were made up, the path's colours count scans.
    pub has_times: bool,
    /// The first pose is of so much later than the first scan, s: the robot had to be found.
    pub found_after_s: f64,
    /// Which poses are believed, as many as there are; empty if all are. The path has a gap where one is not.
    pub trust: &'a [bool],
    /// Walls of parts that are drawn twice.
    pub contradicted: &'a [Point2],
}

impl PictureNotes<'_> {
    fn is_trusted(&self, pose: usize) -> bool {
        self.trust.get(pose).copied().unwrap_or(true)
    }
}

/// Writes the picture of `raster` with the path `poses` to `target`.
///
/// # Errors
/// If the file cannot be written.
pub fn write_picture(
    target: &Path,
    raster: &Raster,
    poses: &[TimedPose],
    notes: &PictureNotes<'_>,
) -> anyhow::Result<()> {
    save_file(target, &png(raster, poses, notes).with_context(|| cannot_write(target))?)
}

/// The picture as the bytes of a PNG file.
///
/// # Errors
/// If encoding fails.
pub fn png(raster: &Raster, poses: &[TimedPose], notes: &PictureNotes<'_>) -> io::Result<Vec<u8>> {
    let zoom = SIDE_MIN.div_ceil(raster.width.max(raster.height)).clamp(1, 8);
    let mut canvas = draw_map(raster, zoom);
    let place = |pose: &TimedPose| {
        let (x, y) = raster.position(pose.map_from_robot.position());
        (x * zoom as f64 + MARGIN as f64, y * zoom as f64 + MARGIN as f64)
    };
    mark_walls(&mut canvas, raster, zoom, notes.contradicted);
    for pair in notes.truth.windows(2) {
        canvas.line(place(&pair[0]), place(&pair[1]), 4.0, TRUTH);
    }
    let path = poses.iter().enumerate().map(|(index, pose)| notes.is_trusted(index).then(|| place(pose)));
    draw_path(&mut canvas, &path.collect::<Vec<_>>());
    let footer = canvas.height - FOOTER;
    draw_scale_bar(&mut canvas, raster.pixel_size_m / zoom as f64);
    if let Some([first, last]) = times(poses, notes) {
        draw_colours(&mut canvas, [&first, &last]);
    }
    draw_legend(&mut canvas, footer + FOOTER_ROWS[1], [!notes.contradicted.is_empty(), !notes.truth.is_empty()]);
    encode(&canvas)
}

/// What the ends of the path's colours stand for.
fn times(poses: &[TimedPose], notes: &PictureNotes<'_>) -> Option<[String; 2]> {
    let (first, last) = (poses.first()?, poses.last()?);
    let (found_s, seconds) = (notes.found_after_s, last.stamp.as_secs_f64() - first.stamp.as_secs_f64());
    Some(match notes.has_times {
        false => ["0".to_owned(), count(poses.len() as u64, "scan")],
        true if found_s > 0.0 => [format!("found at {found_s:.0} s"), format!("{:.0} s", found_s + seconds)],
        true => ["0".to_owned(), format!("{seconds:.0} s")],
    })
}

fn draw_map(raster: &Raster, zoom: usize) -> Canvas {
    let width = (raster.width * zoom + 2 * MARGIN).max(WIDTH_MIN);
    let mut canvas = Canvas::new(width, raster.height * zoom + 2 * MARGIN + FOOTER, UNKNOWN);
    for (index, occupancy) in raster.pixels.iter().enumerate() {
        let colour = match occupancy {
            Occupancy::Unknown => continue,
            Occupancy::Free => FREE,
            Occupancy::Occupied => OCCUPIED,
        };
        let (x, y) = (index % raster.width * zoom + MARGIN, index / raster.width * zoom + MARGIN);
        canvas.fill(x, y, zoom, zoom, colour);
    }
    canvas.fill(0, canvas.height - FOOTER, width, FOOTER, FREE);
    canvas
}

fn mark_walls(canvas: &mut Canvas, raster: &Raster, zoom: usize, walls: &[Point2]) {
    let side = (f64::from(CELL_M) / raster.pixel_size_m * zoom as f64).max(1.0);
    for wall in walls {
        let (x, y) = raster.position(*wall);
        let corner = |middle: f64| (middle * zoom as f64 + MARGIN as f64 - side / 2.0).max(0.0) as usize;
        canvas.fill(corner(x), corner(y), side.round() as usize, side.round() as usize, CONTRADICTED);
    }
}

/// * `path` — `None` where nobody knows
fn draw_path(canvas: &mut Canvas, path: &[Option<(f64, f64)>]) {
    let radius = 1.2;
    for (index, pair) in path.windows(2).enumerate() {
        if let [Some(from), Some(to)] = *pair {
            canvas.line(from, to, radius, colour_at(index as f64 / path.len() as f64));
        }
    }
    let mut known = path.iter().flatten();
    let first = known.next();
    for (place, colour) in first.map(|&p| (p, START)).into_iter().chain(known.last().or(first).map(|&p| (p, END))) {
        canvas.line(place, place, 8.0, FREE);
        canvas.line(place, place, 6.0, colour);
    }
}

/// A bar of a round length, about a quarter of the picture, with its length beside it.
fn draw_scale_bar(canvas: &mut Canvas, pixel_size_m: f64) {
    let length_m = round_length(canvas.width as f64 / 4.0 * pixel_size_m);
    let length = (length_m / pixel_size_m).round() as usize;
    let y = canvas.height - FOOTER + FOOTER_ROWS[0];
    canvas.fill(MARGIN, y - 2, length, 4, OCCUPIED);
    canvas.fill(MARGIN, y - 8, 2, 16, OCCUPIED);
    canvas.fill(MARGIN + length - 2, y - 8, 2, 16, OCCUPIED);
    canvas.text(MARGIN + length + 10, y - 7, 2, &format!("{length_m} m"), OCCUPIED);
}

/// The largest of 1, 2, 5 times a power of ten that is not above `limit`.
fn round_length(limit: f64) -> f64 {
    let decade = 10_f64.powi(limit.max(1e-3).log10().floor() as i32);
    let steps = [5.0, 2.0, 1.0].into_iter().map(|step| step * decade);
    steps.into_iter().find(|&length| length <= limit).unwrap_or(decade)
}

/// The colours of path or cloud from first to last, and what these stand for.
fn draw_colours(canvas: &mut Canvas, [first, last]: [&str; 2]) {
    let bar = canvas.width / 5;
    let y = canvas.height - FOOTER + FOOTER_ROWS[0];
    let left = canvas.width.saturating_sub(MARGIN + Canvas::text_width(2, last) + 10 + bar);
    for x in 0..bar {
        canvas.fill(left + x, y - 4, 1, 8, colour_at(x as f64 / bar as f64));
    }
    canvas.text(left.saturating_sub(Canvas::text_width(2, first) + 10), y - 7, 2, first, OCCUPIED);
    canvas.text(left + bar + 10, y - 7, 2, last, OCCUPIED);
}

fn encode(canvas: &Canvas) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let (width, height) = (canvas.width as u32, canvas.height as u32);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    writer.write_image_data(&canvas.bytes).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maps::occupancy::{MapConfig, OccupancyMap};
    use lrfslam_core::geometry::Pose2;
    use lrfslam_core::scan::{Beam, Echo, RangeScan};
    use lrfslam_core::sweep::Sweep;
    use lrfslam_core::time::{Duration, Instant};

    fn raster(side_max: u32) -> Raster {
        let mut map = OccupancyMap::new(MapConfig::default());
        let beam = |i: i32| Beam {
            bearing_rad: f64::from(i).to_radians() as f32,
            offset: Duration::ZERO,
            echo: Echo::Hit(4.0),
        };
        let beams: Vec<Beam> = (0..360).map(beam).collect();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        map.insert(&Sweep::at_rest(scan, Pose2::IDENTITY), Pose2::IDENTITY);
        map.raster(side_max).unwrap()
    }

    const NOTES: PictureNotes<'_> =
        PictureNotes { truth: &[], has_times: true, found_after_s: 0.0, trust: &[], contradicted: &[] };

    fn poses() -> Vec<TimedPose> {
        let pose = |i: i32| TimedPose {
            stamp: Instant::from_micros(i64::from(i) * 1_000_000),
            map_from_robot: Pose2::new(i as f32 * 0.1, 0.0, 0.0),
        };
        (0..20).map(pose).collect()
    }

    fn pixels(bytes: Vec<u8>) -> (usize, Vec<u8>) {
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        (reader.next_frame(&mut pixels).unwrap().width as usize, pixels)
    }

    #[test]
    fn picture_is_a_png_of_the_expected_size_with_the_path_on_it() {
        let raster = raster(4000);
        let (width, pixels) = pixels(png(&raster, &poses(), &NOTES).unwrap());
        let zoom = 1000_usize.div_ceil(raster.width);
        assert_eq!(width, raster.width * zoom + 2 * MARGIN);
        for colour in [FREE, UNKNOWN, OCCUPIED, START, END] {
            assert!(pixels.chunks(3).any(|pixel| pixel == colour), "{colour:?} is missing");
        }
    }

    #[test]
    fn the_path_has_a_gap_where_a_pose_is_not_believed() {
        let coloured = |trust: &[bool]| {
            let notes = PictureNotes { trust, ..NOTES };
            let plain = [FREE, UNKNOWN, OCCUPIED, START, END];
            let (_, pixels) = pixels(png(&raster(4000), &poses(), &notes).unwrap());
            pixels.chunks(3).filter(|pixel| !plain.iter().any(|colour| pixel == colour)).count()
        };
        let lost: Vec<bool> = (0..20).map(|pose| !(5..15).contains(&pose)).collect();
        assert_eq!(coloured(&[true; 20]), coloured(&[]));
        assert!(coloured(&lost) < coloured(&[]));
    }

    #[test]
    fn walls_that_are_drawn_twice_are_marked_where_they_are() {
        let raster = raster(4000);
        let marked = |contradicted: &[Point2]| {
            let (width, pixels) = pixels(png(&raster, &poses(), &PictureNotes { contradicted, ..NOTES }).unwrap());
            let places = pixels.chunks(3).enumerate().filter(|(_, pixel)| *pixel == CONTRADICTED);
            let map = places.map(|(index, _)| (index % width, index / width));
            map.filter(|(_, y)| *y < pixels.len() / 3 / width - FOOTER).collect::<Vec<_>>()
        };
        let zoom = 1000_usize.div_ceil(raster.width);
        let at = Point2::new(-3.0, 1.5);
        let (x, y) = raster.position(at);
        let places = marked(&[at, Point2::new(1e9, f32::NAN)]);
        assert_eq!(places.len(), (0.15 / raster.pixel_size_m * zoom as f64).round().powi(2) as usize);
        let near = |found: usize, wanted: f64| {
            (found as f64 - wanted * zoom as f64 - MARGIN as f64).abs() <= 2.0 * zoom as f64
        };
        assert!(places.iter().all(|place| near(place.0, x) && near(place.1, y)), "{places:?}");
        assert!(marked(&[]).is_empty());
    }

    #[test]
    fn legend_names_all_marks_and_the_truth_where_it_is_drawn() {
        let (raster, poses) = (raster(4000), poses());
        let footer = |notes: &PictureNotes<'_>| {
            let (width, pixels) = pixels(png(&raster, &poses, notes).unwrap());
            pixels[pixels.len() - 3 * width * FOOTER..].to_vec()
        };
        let has = |footer: &[u8], colour: Rgb| footer.chunks(3).any(|pixel| pixel == colour);
        let plain = footer(&NOTES);
        assert!([UNKNOWN, OCCUPIED, START, END].into_iter().all(|colour| has(&plain, colour)) && !has(&plain, TRUTH));
        assert!(has(&footer(&PictureNotes { truth: &poses, ..NOTES }), TRUTH));
        let twice = footer(&PictureNotes { contradicted: &[Point2::new(1.0, 1.0)], ..NOTES });
        assert!(has(&twice, CONTRADICTED) && !has(&plain, CONTRADICTED));
    }

    #[test]
    fn times_are_told_from_the_first_scan_and_made_up_ones_not_as_seconds() {
        let told = |notes: PictureNotes<'_>| times(&poses(), &notes).unwrap();
        assert_eq!(told(NOTES), ["0", "19 s"]);
        assert_eq!(told(PictureNotes { found_after_s: 12.4, ..NOTES }), ["found at 12 s", "31 s"]);
        assert_eq!(told(PictureNotes { has_times: false, ..NOTES }), ["0", "20 scans"]);
        assert_eq!(times(&[], &NOTES), None);
    }

    #[test]
    fn tiny_maps_and_empty_paths_are_drawn_too() {
        assert!(png(&raster(2), &[], &NOTES).is_ok());
        let nowhere = TimedPose { stamp: Instant::default(), map_from_robot: Pose2::new(1e30, f32::NAN, 0.0) };
        assert!(png(&raster(50), &[nowhere, nowhere], &NOTES).is_ok());
    }

    #[test]
    fn scale_bar_has_a_round_length() {
        assert_eq!([0.3, 7.0, 19.9, 20.0, 55.0].map(round_length), [0.2, 5.0, 10.0, 20.0, 50.0]);
    }
}
