//! What the marks and colours of a map's picture mean, in words.

use super::canvas::{Canvas, Rgb};
use super::{CONTRADICTED, END, FREE, MARGIN, OCCUPIED, START, TRUTH, UNKNOWN};

/// From one entry to the next, pixels.
const SPACE: usize = 22;

/// How an entry's colour is shown.
enum Sample {
    /// As start and end are on the path.
    Disc(Rgb),
    /// As cells are.
    Square(Rgb),
    /// As a path is.
    Line(Rgb),
}

/// Draws the legend with its middle at height `y`.
pub(super) fn draw_legend(canvas: &mut Canvas, y: usize, [has_contradicted, has_truth]: [bool; 2]) {
    let entries = [
        (true, Sample::Disc(START), "start"),
        (true, Sample::Disc(END), "end"),
        (true, Sample::Square(OCCUPIED), "wall"),
        (has_contradicted, Sample::Square(CONTRADICTED), "drawn twice"),
        (true, Sample::Square(FREE), "free"),
        (true, Sample::Square(UNKNOWN), "unknown"),
        (has_truth, Sample::Line(TRUTH), "truth"),
    ];
    let mut x = MARGIN;
    for (_, sample, word) in entries.into_iter().filter(|(is_there, ..)| *is_there) {
        draw_sample(canvas, (x, y), &sample);
        canvas.text(x + 24, y - 7, 2, word, OCCUPIED);
        x += 24 + Canvas::text_width(2, word) + SPACE;
    }
}

fn draw_sample(canvas: &mut Canvas, (x, y): (usize, usize), sample: &Sample) {
    let middle = (x as f64 + 8.0, y as f64);
    match *sample {
        Sample::Disc(colour) => canvas.line(middle, middle, 6.0, colour),
        Sample::Square(colour) => {
            canvas.fill(x, y - 8, 16, 16, OCCUPIED);
            canvas.fill(x + 1, y - 7, 14, 14, colour);
        }
        Sample::Line(colour) => canvas.line((x as f64, y as f64), (x as f64 + 16.0, y as f64), 4.0, colour),
    }
}
