//! An image in memory: rectangles, smooth lines, and a little text.

use super::glyphs::{GLYPH_WIDTH, glyph};

/// Red, green, blue.
pub(super) type Rgb = [u8; 3];

/// Pixels row by row from the top.
pub(super) struct Canvas {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) bytes: Vec<u8>,
}

impl Canvas {
    pub fn new(width: usize, height: usize, colour: Rgb) -> Self {
        Self { width, height, bytes: colour.repeat(width * height) }
    }

    /// Fills a rectangle; what lies outside is cut off.
    pub fn fill(&mut self, x: usize, y: usize, width: usize, height: usize, colour: Rgb) {
        for row in y..(y + height).min(self.height) {
            for column in x..(x + width).min(self.width) {
                let at = 3 * (row * self.width + column);
                self.bytes[at..at + 3].copy_from_slice(&colour);
            }
        }
    }

    /// A line of round ends from `a` to `b`, 2 · `radius` wide, smooth at its edge; a disc where they are one.
    pub fn line(&mut self, a: (f64, f64), b: (f64, f64), radius: f64, colour: Rgb) {
        if ![a.0, a.1, b.0, b.1].iter().all(|v| v.is_finite()) {
            return;
        }
        let span = |u: f64, v: f64, limit: usize| {
            let from = (u.min(v) - radius - 1.0).clamp(0.0, limit as f64) as usize;
            let to = (u.max(v) + radius + 2.0).clamp(0.0, limit as f64) as usize;
            from..to
        };
        for row in span(a.1, b.1, self.height) {
            for column in span(a.0, b.0, self.width) {
                let distance = distance_to_segment((column as f64 + 0.5, row as f64 + 0.5), a, b);
                self.blend(column, row, (radius + 0.5 - distance).clamp(0.0, 1.0), colour);
            }
        }
    }

    fn blend(&mut self, column: usize, row: usize, cover: f64, colour: Rgb) {
        let at = 3 * (row * self.width + column);
        for (byte, channel) in self.bytes[at..at + 3].iter_mut().zip(colour) {
            *byte = (f64::from(*byte) * (1.0 - cover) + f64::from(channel) * cover).round() as u8;
        }
    }

    /// Writes `text` with its upper left corner at (`x`, `y`), every dot `scale` pixels; unknown letters are blank.
    pub fn text(&mut self, x: usize, y: usize, scale: usize, text: &str, colour: Rgb) {
        for (place, letter) in text.chars().enumerate() {
            let left = x + place * (GLYPH_WIDTH + 1) * scale;
            for (row, bits) in glyph(letter).into_iter().enumerate() {
                for column in (0..GLYPH_WIDTH).filter(|column| bits >> (GLYPH_WIDTH - 1 - column) & 1 == 1) {
                    self.fill(left + column * scale, y + row * scale, scale, scale, colour);
                }
            }
        }
    }

    /// Width of [`text`](Self::text), pixels.
    pub fn text_width(scale: usize, text: &str) -> usize {
        text.chars().count() * (GLYPH_WIDTH + 1) * scale
    }
}

fn distance_to_segment(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length_squared = dx * dx + dy * dy;
    let along = if length_squared > 0.0 { ((p.0 - a.0) * dx + (p.1 - a.1) * dy) / length_squared } else { 0.0 };
    let along = along.clamp(0.0, 1.0);
    (p.0 - a.0 - along * dx).hypot(p.1 - a.1 - along * dy)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(canvas: &Canvas) -> Vec<String> {
        let sign = |pixel: &[u8]| if pixel[0] < 128 { '#' } else { '.' };
        canvas.bytes.chunks(3 * canvas.width).map(|row| row.chunks(3).map(sign).collect()).collect()
    }

    #[test]
    fn line_and_disc_look_as_they_should() {
        let mut canvas = Canvas::new(9, 5, [255; 3]);
        canvas.line((1.5, 2.5), (3.5, 2.5), 0.5, [0; 3]);
        canvas.line((6.5, 2.5), (6.5, 2.5), 1.2, [0; 3]);
        assert_eq!(picture(&canvas), [".........", "......#..", ".###.###.", "......#..", "........."]);
    }

    #[test]
    fn text_is_legible_and_cut_at_the_edge() {
        let mut canvas = Canvas::new(8, 7, [255; 3]);
        canvas.text(0, 0, 1, "17", [0; 3]);
        assert_eq!(
            picture(&canvas),
            ["..#...##", ".##.....", "..#.....", "..#.....", "..#....#", "..#....#", ".###...#"]
        );
    }

    #[test]
    fn drawing_outside_is_cut_off() {
        let mut canvas = Canvas::new(4, 4, [255; 3]);
        canvas.fill(3, 3, 100, 100, [0; 3]);
        canvas.line((-1e9, 1e9), (-1e9, 1e9), 3.0, [0; 3]);
        canvas.line((f64::NAN, 0.0), (0.0, 0.0), 3.0, [0; 3]);
        assert_eq!(picture(&canvas), ["....", "....", "....", "...#"]);
    }
}
