//! Which part of the map is seen, and how large.

use super::picture::Bounds;

/// A screen of so many metres is the nearest, and the farthest.
const NEAREST_M: f32 = 1.0;
const FARTHEST_M: f32 = 20_000.0;
/// Share of the picture that an arrow key moves it by.
const PAN: f32 = 0.25;
/// Left free around all that is known.
const MARGIN: f32 = 1.1;

/// What moves the picture by itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Mode {
    /// All that is known is seen.
    #[default]
    All,
    /// The robot is in the middle.
    Follow,
    /// It stays as it is.
    Still,
}

/// See the [module](self).
#[derive(Debug, Clone, Default)]
pub(super) struct View {
    mode: Mode,
    /// Middle of the picture, m.
    middle: [f32; 2],
    /// Edge of a dot, m; 0 before anything was seen.
    dot_m: f32,
    /// Dots across and down.
    size: [i32; 2],
    /// An answer to the last key.
    pub notice: &'static str,
    /// The user has asked for the end.
    pub is_stopping: bool,
}

impl View {
    /// Takes a picture of so many dots, of what lies within `bounds`, with the robot there.
    pub(super) fn settle(&mut self, size: [i32; 2], bounds: Option<Bounds>, robot: Option<[f32; 2]>) {
        self.size = size;
        if let Some((low, high)) = bounds.filter(|_| self.mode == Mode::All || self.dot_m == 0.0) {
            let edge_m = |axis: usize| MARGIN * (high[axis] - low[axis]) / size[axis].max(1) as f32;
            self.middle = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]));
            self.set_dot_m(edge_m(0).max(edge_m(1)));
        }
        if let Some(robot) = robot.filter(|_| self.mode == Mode::Follow) {
            self.middle = robot;
        }
    }

    fn set_dot_m(&mut self, dot_m: f32) {
        let across = self.size[0].max(1) as f32;
        self.dot_m = dot_m.clamp(NEAREST_M / across, FARTHEST_M / across);
    }

    /// Edge of a dot, m.
    pub(super) fn dot_m(&self) -> f32 {
        self.dot_m
    }

    /// The dot at a point of the map, m.
    pub(super) fn dot(&self, [x, y]: [f32; 2]) -> [i32; 2] {
        let [across, down] = self.size.map(|dots| dots / 2);
        let dots = |way_m: f32| (way_m / self.dot_m).floor().clamp(-1e8, 1e8) as i32;
        [across + dots(x - self.middle[0]), down - 1 - dots(y - self.middle[1])]
    }

    /// Magnifies.
    pub(super) fn zoom(&mut self, factor: f32) {
        self.set_dot_m(self.dot_m / factor);
        if self.mode == Mode::All {
            self.mode = Mode::Still;
        }
    }

    /// Moves by shares of the picture's shorter side, to the right and up.
    pub(super) fn pan(&mut self, right: f32, up: f32) {
        let way_m = PAN * self.dot_m * self.size[0].min(self.size[1]) as f32;
        self.middle = [self.middle[0] + right * way_m, self.middle[1] + up * way_m];
        self.mode = Mode::Still;
    }

    /// Keeps the robot in the middle, or no longer.
    pub(super) fn follow(&mut self) {
        self.mode = if self.mode == Mode::Follow { Mode::Still } else { Mode::Follow };
    }

    /// Shows all that is known, now and later.
    pub(super) fn show_all(&mut self) {
        self.mode = Mode::All;
    }

    /// The longest round length that is not longer than so many dots, m.
    pub(super) fn scale_m(&self, dots: i32) -> f32 {
        let longest = (dots as f32 * self.dot_m).max(1e-3);
        let ten = 10.0_f32.powf(longest.log10().floor());
        [5.0, 2.0].into_iter().map(|part| part * ten).find(|length| *length <= longest).unwrap_or(ten)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_is_seen_until_the_user_moves_it() {
        let mut view = View::default();
        view.settle([100, 100], Some(([-10.0, 0.0], [10.0, 10.0])), None);
        assert_eq!((view.dot([0.0, 5.0]), view.scale_m(30)), ([50, 49], 5.0));
        for corner in [[-10.0, 0.0], [10.0, 10.0]] {
            assert!(view.dot(corner).iter().all(|dot| (0..100).contains(dot)), "{:?}", view.dot(corner));
        }
        view.zoom(2.0);
        view.pan(1.0, 0.0);
        let moved = view.clone();
        view.settle([100, 100], Some(([-99.0, 0.0], [10.0, 10.0])), Some([3.0, 4.0]));
        assert_eq!(view.dot([0.0, 5.0]), moved.dot([0.0, 5.0]));
        view.follow();
        view.settle([100, 100], None, Some([3.0, 4.0]));
        assert_eq!(view.dot([3.0, 4.0]), [50, 49]);
        (0..200).for_each(|_| view.zoom(2.0));
        assert!(view.dot_m() >= 0.009);
    }
}
