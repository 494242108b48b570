//! Sizes of frames that follow from their first bytes.

use super::FRAME_MAX;
use crate::expr::{Expr, Scope};
use crate::value::Value;

/// The first bytes of a frame as variables `b0`, `b1`, ..
struct Head<'a>(&'a [u8]);

impl Scope for Head<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        self.0
            .get(place_of(name)?)
            .map(|&byte| Value::Int(byte.into()))
    }
}

/// The size of a frame, computed from its first bytes.
#[derive(Clone, Debug)]
pub(crate) struct HeadSize {
    expr: Expr,
    /// The offset of a byte and the sizes by its value (0: no frame), if the size depends on one
    /// byte only.
    by_byte: Option<(usize, Box<[u16; 256]>)>,
}

impl HeadSize {
    /// The size that `expr` gives over the first `head` bytes.
    pub(crate) fn new(expr: Expr, head: usize) -> Self {
        let mut places = expr.names().into_iter().map(place_of);
        let first = places.next().unwrap_or(Some(0));
        let is_one = places.all(|place| place == first);
        let by_byte = first.filter(|at| is_one && *at < head).map(|at| {
            let mut sizes = Box::new([0; 256]);
            let mut bytes = vec![0; head];
            for (byte, size) in (0..=255).zip(sizes.iter_mut()) {
                bytes[at] = byte;
                let found = computed(&expr, &bytes);
                *size = found.and_then(|size| u16::try_from(size).ok()).unwrap_or(0);
            }
            (at, sizes)
        });
        Self { expr, by_byte }
    }

    /// The source text of the expression.
    pub(crate) fn source(&self) -> &str {
        self.expr.source()
    }

    /// The expression.
    pub(crate) const fn expr(&self) -> &Expr {
        &self.expr
    }

    /// The size of the frame that begins with `head`; `None` if no frame begins so.
    pub(in crate::framing) fn of(&self, head: &[u8]) -> Option<usize> {
        match &self.by_byte {
            Some((at, sizes)) => {
                let size = usize::from(sizes[usize::from(*head.get(*at)?)]);
                (size > 0).then_some(size)
            }
            None => computed(&self.expr, head),
        }
    }
}

/// The offset of the byte called `b0`, `b1`, ..
fn place_of(name: &str) -> Option<usize> {
    name.strip_prefix('b')?.parse().ok()
}

fn computed(size: &Expr, head: &[u8]) -> Option<usize> {
    let size = size.eval(&Head(head)).ok()?.as_int()?;
    usize::try_from(size)
        .ok()
        .filter(|size| (1..=FRAME_MAX).contains(size))
}
