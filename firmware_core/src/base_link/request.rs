//! A request to the slave, and the test for its answer.

use protocols::avr::{ChecksumOrder, Frame};

use super::{Defects, READ_MAX, WRITE_MAX};

/// A read or write request to the slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    pub(super) register: u8,
    pub(super) count: u8,
    /// Data of a write.
    pub(super) data: Option<[u8; WRITE_MAX]>,
}

impl Request {
    /// Reads `count` registers, at most [`READ_MAX`], from `register` on.
    pub const fn read(register: u8, count: u8) -> Self {
        assert!(count as usize <= READ_MAX, "a reply must fit its place");
        Self {
            register,
            count,
            data: None,
        }
    }

    /// Writes the registers from `register` on.
    pub const fn write<const N: usize>(register: u8, values: [u8; N]) -> Self {
        const { assert!(N <= WRITE_MAX, "data must fit their place") };
        let mut data = [0; WRITE_MAX];
        data.split_at_mut(N).0.copy_from_slice(&values);
        #[expect(clippy::cast_possible_truncation, reason = "at most WRITE_MAX")]
        let count = N as u8;
        Self {
            register,
            count,
            data: Some(data),
        }
    }

    /// The first register of the request.
    pub const fn register(&self) -> u8 {
        self.register
    }

    /// Whether the request is a write.
    pub const fn is_write(&self) -> bool {
        self.data.is_some()
    }

    pub(super) fn frame(&self, order: ChecksumOrder) -> Frame {
        match &self.data {
            Some(data) => Frame::write(self.register, &data[..usize::from(self.count)], order),
            None => Frame::read(self.register, self.count, order),
        }
    }

    /// Whether `frame` is the slave's answer to this request.
    pub(super) fn is_answered_by(&self, frame: &Frame, defects: &Defects) -> bool {
        if frame.register() != self.register {
            return false;
        }
        let count = if self.is_write() { 0 } else { self.count };
        let is_read = !self.is_write();
        let is_short = is_read && frame.is_write() && frame.count() < count;
        let is_acknowledgement = is_read && !frame.is_write() && frame.count() == 0;
        (frame.is_write() != self.is_write() && frame.count() == count)
            || (defects.takes_short_replies && is_short)
            || (defects.takes_acknowledgements && is_acknowledgement)
    }

    /// Whether one of the two requests replaces the other: the same registers in the same
    /// direction.
    pub(super) fn replaces(&self, other: &Self) -> bool {
        (self.register, self.count, self.is_write())
            == (other.register, other.count, other.is_write())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORDER: ChecksumOrder = ChecksumOrder::LowFirst;
    const READ: Request = Request::read(36, 10);

    fn data(count: usize) -> Frame {
        Frame::write(36, &[7; 12][..count], ORDER)
    }

    /// Ten bytes answer a request for ten. Fewer bytes answer it only with the defect of short
    /// replies (MA-04), and none at all only if acknowledgements count as data (MA-05).
    #[test]
    fn an_answer_has_as_many_bytes_as_were_asked_for() {
        let sound = Defects::NONE;
        let short = Defects {
            takes_short_replies: true,
            ..sound
        };
        let empty = Defects {
            takes_acknowledgements: true,
            ..sound
        };
        let taken = |frame: &Frame| [sound, short, empty].map(|it| READ.is_answered_by(frame, &it));
        assert_eq!(taken(&data(10)), [true; 3]);
        assert_eq!(taken(&data(9)), [false, true, false]);
        assert_eq!(taken(&data(0)), [false, true, false]);
        assert_eq!(taken(&data(11)), [false; 3]);
        assert_eq!(taken(&Frame::read(36, 0, ORDER)), [false, false, true]);
        assert_eq!(taken(&Frame::read(36, 10, ORDER)), [false; 3]);
        assert_eq!(taken(&Frame::read(36, 3, ORDER)), [false; 3]);
        assert_eq!(taken(&Frame::write(37, &[7; 10], ORDER)), [false; 3]);
        let write = Request::write(36, [1, 2]);
        let taken =
            |frame: &Frame| [sound, short, empty].map(|it| write.is_answered_by(frame, &it));
        assert_eq!(taken(&Frame::read(36, 0, ORDER)), [true; 3]);
        assert_eq!(
            [taken(&data(2)), taken(&data(0)), taken(&data(1))],
            [[false; 3]; 3]
        );
        assert_eq!(taken(&Frame::read(36, 2, ORDER)), [false; 3]);
    }

    #[test]
    fn a_request_replaces_one_of_the_same_registers_and_direction() {
        assert!(READ.replaces(&Request::read(36, 10)) && !READ.is_write());
        assert!(!READ.replaces(&Request::read(36, 9)) && !READ.replaces(&Request::read(35, 10)));
        let write = Request::write(36, [1, 2]);
        assert!(write.replaces(&Request::write(36, [3, 4])) && write.is_write());
        assert!(!write.replaces(&Request::read(36, 2)) && write.register() == 36);
        assert_eq!(write.frame(ORDER).data(), [1, 2]);
        assert_eq!(READ.frame(ORDER), Frame::read(36, 10, ORDER));
    }
}
