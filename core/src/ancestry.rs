//! The tree of particles: who descends from whom (thesis §3.2.3.2).
//!
//! Every living particle is a leaf; an inner node is an ancestor that at least two lines of living particles share. What
//! only one line has is merged into one node at once, so the tree stays small however long the robot drives.
//!
//! # Invariants, after every call
//! * A node is a leaf or has at least two children (the root may be the only node: then it is the only leaf).
//! * With P leaves there are at most 2P − 1 nodes, and no leaf is deeper than P − 1.
//! * Children stand in the order in which they were added: walking the tree depth first meets leaves in a fixed order.
//!
//! A change is told to a [`NodeObserver`] (the map), so that what belongs to a node dies and moves with it.
//! The tree knows no maps and no poses.
//!
//! Departure from the original: it prunes, then collapses in a second pass over all nodes; here the one node
//! that can have become an only child is merged at once, so that no state in between can be seen.

/// Name of a node. 0 is no node, so that zeroed memory is an empty pool.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u16);

impl NodeId {
    /// No node at all.
    pub const NONE: Self = Self(0);
    /// The ancestor of all.
    pub const ROOT: Self = Self(1);

    /// Place in a table with one entry for each node of the pool.
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    fn some(self) -> Option<Self> {
        (self != Self::NONE).then_some(self)
    }
}

/// Memory of one node. All zero when free.
#[derive(Debug, Clone, Copy, Default)]
pub struct Node {
    parent: NodeId,
    first_child: NodeId,
    last_child: NodeId,
    /// The next sibling; of a free node, the next free one.
    next: NodeId,
    previous: NodeId,
    children: u16,
    /// Of a leaf: index of its particle.
    particle: u16,
}

impl Node {
    /// A node that is in no tree.
    pub const FREE: Self = Self {
        parent: NodeId::NONE,
        first_child: NodeId::NONE,
        last_child: NodeId::NONE,
        next: NodeId::NONE,
        previous: NodeId::NONE,
        children: 0,
        particle: 0,
    };
}

/// Is told what happens to nodes, while it happens.
pub trait NodeObserver {
    /// `node` is gone and nothing descends from it; its name may come back.
    fn died(&mut self, node: NodeId);

    /// The only child `child` has become one with `parent`, whose name stays; `child`'s may come back.
    fn merged(&mut self, child: NodeId, parent: NodeId);
}

impl NodeObserver for () {
    fn died(&mut self, _: NodeId) {}
    fn merged(&mut self, _: NodeId, _: NodeId) {}
}

/// The pool of nodes is too small or too large.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{0} nodes: expected 2 to 65535")]
pub struct AncestryMemoryError(pub usize);

/// The tree, over memory lent by the caller; see the [module](self).
#[derive(Debug)]
pub struct Ancestry<'m> {
    /// Entry 0 is unused.
    nodes: &'m mut [Node],
    /// Nodes ever taken, entry 0 included.
    taken: u16,
    free: NodeId,
    used: u16,
}

impl<'m> Ancestry<'m> {
    /// A tree of the root alone, which is the leaf of particle 0.
    ///
    /// * `nodes` — 2P entries are enough for P particles, one of them stays unused
    ///
    /// # Errors
    /// [`AncestryMemoryError`] if there are fewer than 2 or more than 65535.
    pub fn new(nodes: &'m mut [Node]) -> Result<Self, AncestryMemoryError> {
        if nodes.len() < 2 || nodes.len() > usize::from(u16::MAX) {
            return Err(AncestryMemoryError(nodes.len()));
        }
        nodes.fill(Node::default());
        Ok(Self { nodes, taken: 2, free: NodeId::NONE, used: 1 })
    }

    /// Living nodes.
    pub fn nodes_used(&self) -> usize {
        usize::from(self.used)
    }

    /// Particles for which the pool is certainly large enough.
    pub fn particles_max(&self) -> usize {
        self.nodes.len() / 2
    }

    /// The node above; `None` for the root.
    pub fn parent(&self, node: NodeId) -> Option<NodeId> {
        self.at(node).parent.some()
    }

    /// Number of children.
    pub fn children(&self, node: NodeId) -> usize {
        usize::from(self.at(node).children)
    }

    /// Index of the particle whose leaf this is; `None` for an inner node.
    pub fn particle(&self, node: NodeId) -> Option<usize> {
        let node = self.at(node);
        (node.children == 0).then_some(usize::from(node.particle))
    }

    /// Says whose leaf `node` is.
    pub fn set_particle(&mut self, node: NodeId, particle: u16) {
        self.edit(node, |node| node.particle = particle);
    }

    /// Edges from the root to `node`.
    pub fn depth(&self, node: NodeId) -> usize {
        self.upwards(node).count().saturating_sub(1)
    }

    /// `node`, its parent, and so on up to the root.
    pub fn upwards(&self, node: NodeId) -> impl Iterator<Item = NodeId> + '_ {
        core::iter::successors(node.some(), |node| self.parent(*node))
    }

    /// The first leaf below `node` (or `node` itself), in depth-first order.
    pub fn first_leaf(&self, node: NodeId) -> NodeId {
        let mut node = node;
        while let Some(child) = self.first_child(node) {
            node = child;
        }
        node
    }

    /// The oldest child.
    pub fn first_child(&self, node: NodeId) -> Option<NodeId> {
        self.at(node).first_child.some()
    }

    /// The next younger child of the same parent.
    pub fn next_sibling(&self, node: NodeId) -> Option<NodeId> {
        self.at(node).next.some()
    }

    /// Adds a leaf below `parent`, after its other children; `None` if the pool is empty (nothing has changed then).
    ///
    /// The caller adds at least two children to a leaf or none: one alone would be the leaf itself.
    pub fn add(&mut self, parent: NodeId) -> Option<NodeId> {
        let id = self.take()?;
        let last = self.at(parent).last_child;
        self.edit(id, |node| *node = Node { parent, previous: last, ..Node::default() });
        self.edit(last, |node| node.next = id);
        self.edit(parent, |node| {
            node.children += 1;
            node.last_child = id;
            if last == NodeId::NONE {
                node.first_child = id;
            }
        });
        Some(id)
    }

    /// Removes a leaf; a parent left with one child is merged with it.
    ///
    /// * returns the parent's name if that happened: it now stands for what its only child was
    /// * the root is not removed: without particles there is no filter
    pub fn prune(&mut self, leaf: NodeId, observer: &mut impl NodeObserver) -> Option<NodeId> {
        let parent = self.parent(leaf)?;
        if self.children(leaf) > 0 {
            return None;
        }
        observer.died(leaf);
        self.unlink(leaf);
        self.give_back(leaf);
        (self.children(parent) == 1).then(|| self.collapse(parent, observer))
    }

    /// Merges the only child of `parent` into it and returns `parent`.
    fn collapse(&mut self, parent: NodeId, observer: &mut impl NodeObserver) -> NodeId {
        let child = self.at(parent).first_child;
        observer.merged(child, parent);
        let Node { first_child, last_child, children, particle, .. } = self.at(child);
        self.edit(parent, |node| *node = Node { first_child, last_child, children, particle, ..*node });
        let mut grandchild = first_child;
        while grandchild != NodeId::NONE {
            self.edit(grandchild, |node| node.parent = parent);
            grandchild = self.at(grandchild).next;
        }
        self.give_back(child);
        parent
    }

    fn unlink(&mut self, leaf: NodeId) {
        let Node { parent, next, previous, .. } = self.at(leaf);
        self.edit(previous, |node| node.next = next);
        self.edit(next, |node| node.previous = previous);
        self.edit(parent, |node| {
            node.children -= 1;
            if node.first_child == leaf {
                node.first_child = next;
            }
            if node.last_child == leaf {
                node.last_child = previous;
            }
        });
    }

    fn take(&mut self) -> Option<NodeId> {
        let id = match self.free.some() {
            Some(id) => id,
            None if usize::from(self.taken) < self.nodes.len() => NodeId(self.taken),
            None => return None,
        };
        if id == self.free {
            self.free = self.at(id).next;
        } else {
            self.taken += 1;
        }
        self.used += 1;
        Some(id)
    }

    fn give_back(&mut self, id: NodeId) {
        let next = self.free;
        self.edit(id, |node| *node = Node { next, ..Node::default() });
        self.free = id;
        self.used -= 1;
    }

    /// A copy of a node; an empty one if there is no such node.
    fn at(&self, id: NodeId) -> Node {
        self.nodes.get(id.index()).copied().unwrap_or_default()
    }

    /// Changes a node; nothing for [`NodeId::NONE`].
    fn edit(&mut self, id: NodeId, change: impl FnOnce(&mut Node)) {
        if let Some(node) = self.nodes.get_mut(id.index()).filter(|_| id != NodeId::NONE) {
            change(node);
        }
    }
}

#[cfg(test)]
mod tests;
