//! Protobuf as it goes over the wire, as far as messages are written here: fields with their numbers, in any order.

/// How a field begins: its number, and what follows.
enum Wire {
    Varint = 0,
    Fixed64 = 1,
    Length = 2,
    Fixed32 = 5,
}

/// A message that is being written.
#[derive(Clone, Debug, Default)]
pub struct Message(Vec<u8>);

impl Message {
    /// Its bytes.
    pub fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push((value & 0x7F) as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn begin(&mut self, field: u32, wire: Wire) {
        self.varint(u64::from(field) << 3 | wire as u64);
    }

    /// `int32`, `int64` and enums; what is below zero has ten bytes.
    pub fn int(mut self, field: u32, value: i64) -> Self {
        self.begin(field, Wire::Varint);
        self.varint(value.cast_unsigned());
        self
    }

    /// `fixed32`.
    pub fn fixed32(mut self, field: u32, value: u32) -> Self {
        self.begin(field, Wire::Fixed32);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// `double`.
    pub fn double(mut self, field: u32, value: f64) -> Self {
        self.begin(field, Wire::Fixed64);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// `repeated double`, packed as proto3 has it.
    pub fn doubles(self, field: u32, values: &[f64]) -> Self {
        let packed: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.bytes(field, &packed)
    }

    /// `bytes`.
    pub fn bytes(mut self, field: u32, value: &[u8]) -> Self {
        self.begin(field, Wire::Length);
        self.varint(value.len() as u64);
        self.0.extend(value);
        self
    }

    /// `string`.
    pub fn text(self, field: u32, value: &str) -> Self {
        self.bytes(field, value.as_bytes())
    }

    /// A message within this one.
    pub fn message(self, field: u32, value: &Self) -> Self {
        self.bytes(field, &value.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of the encoding's own description.
    #[test]
    fn fields_are_laid_out_as_protobuf_describes_it() {
        assert_eq!(Message::default().int(1, 150).into_bytes(), [0x08, 0x96, 0x01]);
        let text = [&[0x12, 0x07][..], b"testing"].concat();
        assert_eq!(Message::default().text(2, "testing").into_bytes(), text);
        let within = Message::default().message(3, &Message::default().int(1, 150));
        assert_eq!(within.into_bytes(), [0x1a, 0x03, 0x08, 0x96, 0x01]);
        let below = [&[0x10][..], &[0xfe], &[0xff; 8], &[0x01]].concat();
        assert_eq!(Message::default().int(2, -2).into_bytes(), below);
        assert_eq!(Message::default().fixed32(16, 7).into_bytes(), [0x85, 0x01, 7, 0, 0, 0]);
        let half = 0.5_f64.to_le_bytes();
        assert_eq!(Message::default().double(1, 0.5).into_bytes(), [&[9][..], &half].concat());
        assert_eq!(Message::default().doubles(1, &[0.5]).into_bytes(), [&[10, 8][..], &half].concat());
    }
}
