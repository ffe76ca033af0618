//! Where a stop lies in the way of another visit, as both ways say.

use lrfslam_core::geometry::Pose2;

use crate::places::closing::Closure;
use crate::pose_f64::PoseF64;

/// Two places that are as near as this are the same, m: chosen.
const SAME_M: f64 = 0.1;

/// Where a stop is found in the way of another visit.
#[derive(Debug, Clone, Copy)]
pub(in crate::mapping::high) struct Places {
    /// The optimum near where it is thought to be.
    pub(in crate::mapping::high) near: Option<Closure>,
    /// The best one about, along the way, unless another one is nearly as good.
    pub(in crate::mapping::high) best: Option<Closure>,
}

impl Places {
    /// Where the newer stop is seen from the older one, if these are its places there, and `back` those of the older one in the way of the newer one.
    pub(in crate::mapping::high) fn and_back(self, back: Self) -> Option<Closure> {
        let near = self.near.and_then(|there| back.near.map_or(Some(there), |back| halfway(there, back)));
        let best = self.best.zip(back.best).and_then(|(there, back)| halfway(there, back));
        let bests = || self.best.into_iter().chain(back.best.map(reversed));
        near.filter(|near| bests().all(|best| are_same(near, &best))).or(best)
    }
}

/// Doors tell another place along the way, to where the robot heads. One that is best beside it is one of distorted walls, as at a turn.
pub(in crate::mapping::high) fn is_along(best: Pose2, thought: Pose2) -> bool {
    f64::from(thought.between(best).y.abs()) <= SAME_M
}

/// Between `there` and `back`, which are of the same two stops; nowhere if they disagree.
fn halfway(there: Closure, back: Closure) -> Option<Closure> {
    let back = reversed(back);
    let older_from_newer = there.older_from_newer.midway(back.older_from_newer);
    are_same(&there, &back).then_some(Closure { older_from_newer, ..there })
}

/// The pose alone: how the older one is seen from the newer one.
fn reversed(closure: Closure) -> Closure {
    Closure { older_from_newer: closure.older_from_newer.between(PoseF64::default()), ..closure }
}

fn are_same(a: &Closure, b: &Closure) -> bool {
    a.older_from_newer.between(b.older_from_newer).distance_m() <= SAME_M
}
