use super::*;
use proptest::prelude::*;
use std::vec::Vec;

fn leaves(tree: &Ancestry<'_>) -> Vec<NodeId> {
    fn visit(tree: &Ancestry<'_>, node: NodeId, found: &mut Vec<NodeId>) {
        match tree.first_child(node) {
            None => found.push(node),
            Some(first) => {
                let children = core::iter::successors(Some(first), |child| tree.next_sibling(*child));
                children.for_each(|child| visit(tree, child, found));
            }
        }
    }
    let mut found = Vec::new();
    visit(tree, NodeId::ROOT, &mut found);
    found
}

fn assert_sound(tree: &Ancestry<'_>, particles: usize) {
    let leaves = leaves(tree);
    assert_eq!(leaves.len(), particles);
    assert!(tree.nodes_used() < 2 * particles, "{} nodes for {particles} particles", tree.nodes_used());
    for leaf in &leaves {
        assert!(tree.depth(*leaf) < particles);
        for node in tree.upwards(*leaf).skip(1) {
            assert!(tree.children(node) >= 2, "an inner node has {} children", tree.children(node));
            let counted = core::iter::successors(tree.first_child(node), |c| tree.next_sibling(*c)).count();
            assert_eq!(counted, tree.children(node));
        }
        assert_eq!(tree.upwards(*leaf).last(), Some(NodeId::ROOT));
    }
}

/// Writes down what it is told.
#[derive(Default)]
struct Diary(Vec<(char, NodeId, NodeId)>);

impl NodeObserver for Diary {
    fn died(&mut self, node: NodeId) {
        self.0.push(('d', node, NodeId::NONE));
    }
    fn merged(&mut self, child: NodeId, parent: NodeId) {
        self.0.push(('m', child, parent));
    }
}

#[test]
fn an_only_child_becomes_its_parent_and_keeps_its_children() {
    let mut nodes = [Node::default(); 8];
    let mut tree = Ancestry::new(&mut nodes).unwrap();
    let left = tree.add(NodeId::ROOT).unwrap();
    let right = tree.add(NodeId::ROOT).unwrap();
    let (a, b) = (tree.add(right).unwrap(), tree.add(right).unwrap());
    tree.set_particle(b, 7);
    let mut diary = Diary::default();
    assert_eq!(tree.prune(left, &mut diary), Some(NodeId::ROOT));
    assert_eq!(diary.0, [('d', left, NodeId::NONE), ('m', right, NodeId::ROOT)]);
    assert_eq!((tree.nodes_used(), tree.children(NodeId::ROOT)), (3, 2));
    assert_eq!((tree.parent(a), tree.parent(b), tree.particle(b)), (Some(NodeId::ROOT), Some(NodeId::ROOT), Some(7)));
    assert_eq!(tree.prune(a, &mut ()), Some(NodeId::ROOT));
    assert_eq!((tree.nodes_used(), tree.particle(NodeId::ROOT)), (1, Some(7)));
    assert_eq!(tree.prune(NodeId::ROOT, &mut ()), None);
    assert_eq!(tree.nodes_used(), 1);
}

#[test]
fn an_inner_node_is_not_pruned() {
    let mut nodes = [Node::default(); 8];
    let mut tree = Ancestry::new(&mut nodes).unwrap();
    let inner = tree.add(NodeId::ROOT).unwrap();
    tree.add(NodeId::ROOT).unwrap();
    tree.add(inner).unwrap();
    tree.add(inner).unwrap();
    assert_eq!(tree.prune(inner, &mut ()), None);
    assert_eq!(tree.nodes_used(), 5);
}

#[test]
fn exhausted_pool_is_a_value_and_changes_nothing() {
    let mut nodes = [Node::default(); 4];
    let mut tree = Ancestry::new(&mut nodes).unwrap();
    let left = tree.add(NodeId::ROOT).unwrap();
    tree.add(NodeId::ROOT).unwrap();
    assert_eq!(tree.add(NodeId::ROOT), None);
    assert_sound(&tree, 2);
    tree.prune(left, &mut ());
    assert!(tree.add(NodeId::ROOT).is_some() && tree.add(NodeId::ROOT).is_some());
    assert_eq!(Ancestry::new(&mut [Node::default()]).unwrap_err(), AncestryMemoryError(1));
}

proptest! {
    /// Random resampling: every leaf gets 0 to 3 children, at least one survives.
    #[test]
    fn resampling_keeps_the_tree_sound(generations in prop::collection::vec(prop::collection::vec(0..4_usize, 12), 1..60)) {
        let mut nodes = [Node::default(); 24];
        let mut tree = Ancestry::new(&mut nodes).unwrap();
        for mut children in generations {
            let mut alive = leaves(&tree);
            children.truncate(alive.len());
            if children.iter().all(|n| *n == 0) {
                children[0] = 1;
            }
            let mut room = 12_usize;
            for count in children.iter_mut() {
                *count = (*count).min(room);
                room -= *count;
            }
            for (index, leaf) in alive.iter().enumerate() {
                tree.set_particle(*leaf, index as u16);
            }
            for (index, count) in children.iter().enumerate() {
                if *count == 0 && let Some(merged) = tree.prune(alive[index], &mut ())
                    && let Some(particle) = tree.particle(merged) {
                        alive[particle] = merged;
                }
            }
            for (leaf, count) in alive.iter().zip(&children) {
                if *count >= 2 {
                    (0..*count).for_each(|_| { tree.add(*leaf).unwrap(); });
                }
            }
            assert_sound(&tree, children.iter().sum());
        }
    }
}
