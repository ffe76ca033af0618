//! Parts of a robot's maps that live here while it is far from them.

use std::collections::BTreeMap;

use lrfslam_core::region::TileAddress;
use lrfslam_core::wire::message::{Page, PagedMap, Recall};

/// The newest page that came from each place. A page that was given back stays: the robot may be reset before it has it.
#[derive(Debug, Clone, Default)]
pub struct Pages {
    bytes: BTreeMap<(PagedMap, TileAddress), Vec<u8>>,
}

impl Pages {
    /// Keeps a page, in place of an older one.
    pub fn keep(&mut self, page: &Page<'_>) {
        self.bytes.insert((page.map, page.address), page.bytes.to_vec());
    }

    /// Number of pages.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// All pages of a map.
    pub fn of(&self, map: PagedMap) -> impl Iterator<Item = Page<'_>> {
        let pages = self.bytes.iter().filter(move |((of, _), _)| *of == map);
        pages.map(|((map, address), bytes)| Page { map: *map, address: *address, bytes })
    }

    /// Those that a robot asks for.
    pub fn asked_for<'p>(&'p self, recall: &'p Recall) -> impl Iterator<Item = Page<'p>> {
        self.of(recall.map).filter(|page| recall.region.contains(page.address))
    }
}
