//! Fields of a message, written and read one by one.

use core::convert::Infallible;

use heapless::Vec;
use micropb::{DecodeError, MessageDecode, PbDecoder, PbEncoder, PbRead, PbWrite, Tag};
use micropb::{WIRE_TYPE_I32, WIRE_TYPE_LEN, WIRE_TYPE_VARINT};

use super::MessageError;

/// Number and wire type of a field.
pub(super) type Key = (u32, u8);

pub(super) const NUMBER_1: Key = (1, WIRE_TYPE_VARINT);
pub(super) const NUMBER_2: Key = (2, WIRE_TYPE_VARINT);
pub(super) const NUMBER_3: Key = (3, WIRE_TYPE_VARINT);
pub(super) const NUMBER_6: Key = (6, WIRE_TYPE_VARINT);
pub(super) const FLOAT_1: Key = (1, WIRE_TYPE_I32);
pub(super) const FLOAT_2: Key = (2, WIRE_TYPE_I32);
pub(super) const FLOAT_3: Key = (3, WIRE_TYPE_I32);
pub(super) const FLOAT_4: Key = (4, WIRE_TYPE_I32);
pub(super) const MESSAGE_1: Key = (1, WIRE_TYPE_LEN);
pub(super) const MESSAGE_2: Key = (2, WIRE_TYPE_LEN);
pub(super) const MESSAGE_3: Key = (3, WIRE_TYPE_LEN);
pub(super) const MESSAGE_4: Key = (4, WIRE_TYPE_LEN);
pub(super) const MESSAGE_5: Key = (5, WIRE_TYPE_LEN);
pub(super) const MESSAGE_6: Key = (6, WIRE_TYPE_LEN);
pub(super) const MESSAGE_7: Key = (7, WIRE_TYPE_LEN);
pub(super) const MESSAGE_8: Key = (8, WIRE_TYPE_LEN);

/// A value that is written field by field.
pub(super) trait Fields {
    fn write<W: PbWrite>(&self, to: &mut PbEncoder<W>) -> Result<(), W::Error>;
}

/// Writes one field.
pub(super) trait FieldWriter {
    type Error;

    fn number(&mut self, field: u32, value: u32) -> Result<(), Self::Error>;

    fn signed(&mut self, field: u32, value: i32) -> Result<(), Self::Error>;

    fn float(&mut self, field: u32, value: f32) -> Result<(), Self::Error>;

    fn message(&mut self, field: u32, value: &impl Fields) -> Result<(), Self::Error>;
}

impl<W: PbWrite> FieldWriter for PbEncoder<W> {
    type Error = W::Error;

    fn number(&mut self, field: u32, value: u32) -> Result<(), W::Error> {
        self.encode_tag(Tag::from_parts(field, WIRE_TYPE_VARINT))?;
        self.encode_varint32(value)
    }

    fn signed(&mut self, field: u32, value: i32) -> Result<(), W::Error> {
        self.encode_tag(Tag::from_parts(field, WIRE_TYPE_VARINT))?;
        self.encode_int32(value)
    }

    fn float(&mut self, field: u32, value: f32) -> Result<(), W::Error> {
        self.encode_tag(Tag::from_parts(field, WIRE_TYPE_I32))?;
        self.encode_float(value)
    }

    fn message(&mut self, field: u32, value: &impl Fields) -> Result<(), W::Error> {
        self.encode_tag(Tag::from_parts(field, WIRE_TYPE_LEN))?;
        self.encode_varint32(u32::try_from(len(value)).unwrap_or(u32::MAX))?;
        value.write(self)
    }
}

/// Counts the written bytes.
struct Counter(usize);

impl PbWrite for Counter {
    type Error = Infallible;

    fn pb_write(&mut self, data: &[u8]) -> Result<(), Infallible> {
        self.0 += data.len();
        Ok(())
    }
}

/// Bytes of a message.
fn len(message: &impl Fields) -> usize {
    let mut counter = PbEncoder::new(Counter(0));
    match message.write(&mut counter) {
        Ok(()) => counter.into_writer().0,
        Err(never) => match never {},
    }
}

/// Writes `message` to the front of `out`; returns its length.
pub(super) fn encode(message: &impl Fields, out: &mut [u8]) -> Result<usize, MessageError> {
    let (len, room) = (len(message), out.len());
    let no_room = MessageError::NoRoom { len, room };
    let space = out.get_mut(..len).ok_or(no_room)?;
    let written = message.write(&mut PbEncoder::new(space));
    written.map(|()| len).map_err(|_| no_room)
}

/// Decodes the message in `payload`.
pub(super) fn decode<T: MessageDecode + Default>(payload: &[u8]) -> Result<T, MessageError> {
    let mut message = T::default();
    message.decode_from_bytes(payload)?;
    Ok(message)
}

/// Reads a message inside a message.
pub(super) fn read<T: MessageDecode + Default, R: PbRead>(
    from: &mut PbDecoder<R>,
) -> Result<T, DecodeError<R::Error>> {
    let mut message = T::default();
    from.decode_submessage_delimited(&mut message)?;
    Ok(message)
}

/// Adds `item` to `list`.
pub(super) fn push<T, E, const N: usize>(
    list: &mut Vec<T, N>,
    item: T,
) -> Result<(), DecodeError<E>> {
    list.push(item).map_err(|_| DecodeError::Capacity)
}

/// Number and wire type of a field that was met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field(Tag);

impl Field {
    pub(super) fn key(self) -> Key {
        (self.0.field_num(), self.0.wire_type())
    }
}

/// Offers each field of the next `len` bytes to `take`, which reads the fields that it knows. If it
/// returns `false`, the field is skipped.
pub(super) fn read_fields<R: PbRead>(
    from: &mut PbDecoder<R>,
    len: usize,
    mut take: impl FnMut(Field, &mut PbDecoder<R>) -> Result<bool, DecodeError<R::Error>>,
) -> Result<(), DecodeError<R::Error>> {
    let end = from.bytes_read().saturating_add(len);
    while from.bytes_read() < end {
        let tag = from.decode_tag()?;
        if !take(Field(tag), from)? {
            from.skip_wire_value(tag.wire_type())?;
        }
    }
    match from.bytes_read() == end {
        true => Ok(()),
        false => Err(DecodeError::WrongLen),
    }
}
