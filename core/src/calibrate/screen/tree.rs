//! From bits to places: what each pattern tells once the coarser ones are known.
//!
//! Patterns are sorted by how many edges they have. A node of the tree is a run of columns (or rows) that the bits so far do
//! not tell apart; the next pattern that changes within the run splits it in two. That covers every code whose words keep
//! neighbours together, Gray's and the plain binary one among them, and still gives a place, only a wider one, when the finest
//! patterns are lost.

use std::ops::Range;

use crate::error::{Error, Result};

/// A run of columns or rows.
#[derive(Debug, Clone)]
struct Node {
    run: Range<usize>,
    /// The bit that splits it, and the nodes of dark and lit.
    split: Option<(usize, [usize; 2])>,
}

/// Decides by bits.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    side: usize,
}

impl Tree {
    /// From the lit columns (or rows) of each bit, coarse to fine.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a bit that lights two parts of a run that lie apart: a code of another kind.
    pub fn new(bits: &[&[bool]], side: usize) -> Result<Self> {
        let mut tree = Self { nodes: vec![Node { run: 0..side, split: None }], side };
        let mut at = 0;
        while at < tree.nodes.len() {
            let run = tree.nodes[at].run.clone();
            let bit = bits.iter().position(|lit| lit[run.clone()].iter().any(|l| *l != lit[run.start]));
            if let Some(bit) = bit {
                let lit = &bits[bit][run.clone()];
                let edge = run.start + lit.iter().take_while(|l| **l == lit[0]).count();
                if bits[bit][edge..run.end].iter().any(|l| *l == lit[0]) {
                    return Err(Error::Unsupported {
                        place: "the patterns".into(),
                        what: "a code whose coarse patterns do not tell the stripes of the fine ones apart".into(),
                        advice: "show Gray codes or 2, 4, 8... stripes, all of them".into(),
                    });
                }
                let first = tree.nodes.len();
                tree.nodes.push(Node { run: run.start..edge, split: None });
                tree.nodes.push(Node { run: edge..run.end, split: None });
                let children = if lit[0] { [first + 1, first] } else { [first, first + 1] };
                tree.nodes[at].split = Some((bit, children));
            }
            at += 1;
        }
        Ok(tree)
    }

    /// The columns (or rows) that bits leave, `lit` by the number of the bit; none that is not known ends the search.
    pub fn find(&self, lit: impl Fn(usize) -> Option<bool>) -> Range<usize> {
        let mut at = 0;
        while let Some((lit, children)) = self.nodes[at].split.and_then(|(bit, children)| Some((lit(bit)?, children))) {
            at = children[usize::from(lit)];
        }
        self.nodes[at].run.clone()
    }

    /// Columns (or rows) of the widest run that all bits together leave.
    pub fn widest(&self) -> usize {
        self.nodes.iter().filter(|node| node.split.is_none()).map(|node| node.run.len()).max().unwrap_or(self.side)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(word: impl Fn(usize) -> usize, bits: u32, side: usize) -> Vec<Vec<bool>> {
        (0..bits).rev().map(|bit| (0..side).map(|at| word(at) >> bit & 1 == 1).collect()).collect()
    }

    #[test]
    fn every_place_is_found_and_fewer_bits_widen_it() {
        for word in [|at: usize| at ^ (at >> 1), |at: usize| at] {
            let lines = code(word, 6, 50);
            for kept in [6, 4, 1] {
                let bits: Vec<&[bool]> = lines[..kept].iter().map(Vec::as_slice).collect();
                let tree = Tree::new(&bits, 50).unwrap();
                assert_eq!(tree.widest(), 1 << (6 - kept));
                (0..50).for_each(|at| {
                    let run = tree.find(|bit| Some(bits[bit][at]));
                    assert!(run.contains(&at) && run.len() <= 1 << (6 - kept), "{at}: {run:?}");
                    assert_eq!(tree.find(|_| None), 0..50);
                });
            }
        }
    }

    #[test]
    fn fine_stripes_alone_tell_nothing() {
        let lines = code(|at| at, 4, 16);
        assert!(Tree::new(&[&lines[3]], 16).unwrap_err().to_string().contains("coarse patterns"));
    }
}
