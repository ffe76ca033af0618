//! A picture of braille dots: two to the right and four down in each character, so a dot is about as wide as high.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};

/// Dots of a character.
pub(super) const DOTS: [i32; 2] = [2, 4];
/// The character without dots.
const BRAILLE: u32 = 0x2800;
/// Bits of a character's dots, by row and column.
const BITS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// What a dot shows; a character has the colour of the last of these in it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Ink {
    /// Nobody has seen it.
    #[default]
    Unknown,
    /// It is seen to be free: a character without dots has a point.
    Free,
    Wall,
    /// A wall of a piece that is not joined to the map.
    Apart,
    Path,
    Particle,
    Hit,
    /// A hit where the map is free.
    Misfit,
}

impl Ink {
    /// Of the sixteen colours, which every terminal has and shows as its user likes.
    fn style(self) -> Style {
        match self {
            Ink::Unknown => Style::new(),
            Ink::Free => Style::new().fg(Color::DarkGray),
            Ink::Wall => Style::new().fg(Color::Reset),
            Ink::Apart => Style::new().fg(Color::Magenta),
            Ink::Path => Style::new().fg(Color::Cyan),
            Ink::Particle => Style::new().fg(Color::LightMagenta),
            Ink::Hit => Style::new().fg(Color::Green),
            Ink::Misfit => Style::new().fg(Color::LightRed),
        }
    }
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Canvas {
    area: Rect,
    cells: Vec<(u8, Ink)>,
}

impl Canvas {
    pub(super) fn new(area: Rect) -> Self {
        Self { area, cells: vec![(0, Ink::Unknown); usize::from(area.width) * usize::from(area.height)] }
    }

    /// Dots across and down.
    pub(super) fn size(&self) -> [i32; 2] {
        [i32::from(self.area.width) * DOTS[0], i32::from(self.area.height) * DOTS[1]]
    }

    fn cell(&mut self, [x, y]: [i32; 2]) -> Option<&mut (u8, Ink)> {
        let [column, row] = [x.div_euclid(DOTS[0]), y.div_euclid(DOTS[1])];
        let is_in = (0..i32::from(self.area.width)).contains(&column) && row >= 0;
        is_in.then(|| row * i32::from(self.area.width) + column).and_then(|at| self.cells.get_mut(at as usize))
    }

    /// Draws a dot; [`Ink::Free`] leaves none.
    pub(super) fn dot(&mut self, [x, y]: [i32; 2], ink: Ink) {
        let bit = BITS[y.rem_euclid(DOTS[1]) as usize][x.rem_euclid(DOTS[0]) as usize];
        if let Some((dots, shown)) = self.cell([x, y]) {
            *dots |= if ink == Ink::Free { 0 } else { bit };
            *shown = ink.max(*shown);
        }
    }

    /// Draws a line; one that is far longer than the picture is left out.
    pub(super) fn line(&mut self, from: [i32; 2], to: [i32; 2], ink: Ink) {
        let [across, down] = [to[0].saturating_sub(from[0]), to[1].saturating_sub(from[1])];
        let steps = across.saturating_abs().max(down.saturating_abs());
        if steps > 4 * self.size().into_iter().max().unwrap_or(0) {
            return;
        }
        let part = |way: i32, step: i32| (f64::from(way) * f64::from(step) / f64::from(steps.max(1))).round() as i32;
        (0..=steps).for_each(|step| self.dot([from[0] + part(across, step), from[1] + part(down, step)], ink));
    }

    pub(super) fn render(&self, buffer: &mut Buffer) {
        let places =
            (self.area.y..self.area.bottom()).flat_map(|y| (self.area.x..self.area.right()).map(move |x| (x, y)));
        for ((x, y), (dots, ink)) in places.zip(&self.cells) {
            let shown = match (dots, ink) {
                (0, Ink::Free) => '·',
                (0, _) => ' ',
                (dots, _) => char::from_u32(BRAILLE + u32::from(*dots)).unwrap_or(' '),
            };
            if let Some(cell) = buffer.cell_mut((x, y)) {
                cell.set_char(shown).set_style(ink.style());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(canvas: &Canvas) -> Vec<String> {
        let mut buffer = Buffer::empty(canvas.area);
        canvas.render(&mut buffer);
        let row = |y| (0..canvas.area.width).map(|x| buffer[(x, y)].symbol()).collect();
        (0..canvas.area.height).map(row).collect()
    }

    #[test]
    fn dots_are_where_they_are_put() {
        let mut canvas = Canvas::new(Rect::new(0, 0, 3, 2));
        canvas.line([0, 0], [5, 0], Ink::Wall);
        canvas.line([0, 7], [0, 4], Ink::Path);
        canvas.dot([5, 7], Ink::Free);
        for outside in [[-1, 0], [6, 0], [0, 8], [0, -1], [i32::MIN, i32::MAX]] {
            canvas.dot(outside, Ink::Hit);
        }
        canvas.line([0, 0], [i32::MAX, i32::MIN], Ink::Hit);
        assert_eq!(shown(&canvas), ["⠉⠉⠉", "⡇ ·"]);
    }
}
