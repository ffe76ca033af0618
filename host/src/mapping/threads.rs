//! Weighing particles on several threads.

use lrfslam_core::distributed_map::Window;
use lrfslam_core::low_slam::Weighing;
use lrfslam_core::particles::Sample;

use super::memory::{SIDE, WindowSlots};

/// Shares the particles out to the calling thread, which uses `own`, and one for each of `windows`.
pub fn weigh_on_threads(
    weighing: &Weighing<'_, '_, SIDE>,
    samples: &mut [Sample],
    own: &mut Window<'_>,
    windows: &mut [WindowSlots],
) {
    let parts = windows.len() + 1;
    std::thread::scope(|scope| {
        let mut rest = samples;
        for (part, slots) in windows.iter_mut().enumerate() {
            let range = weighing.share(part, parts);
            let (its, others) = rest.split_at_mut(weighing.samples_of(range.clone()));
            rest = others;
            // Slots that `Window::new` does not take are found out when the filter is made: they are as many there.
            let Ok(mut window) = Window::new(slots) else { continue };
            scope.spawn(move || weighing.weigh(range, its, &mut window));
        }
        weighing.weigh(weighing.share(parts - 1, parts), rest, own);
    });
}
