//! As much of FlatBuffers as AEDAT 4 needs: reading tables with every offset checked, and laying them out.
//! (<https://flatbuffers.dev/internals/>)

/// A table inside a buffer. Positions count from the buffer's beginning.
#[derive(Clone, Copy, Debug)]
pub(super) struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
    fields: usize,
    fields_length: usize,
}

fn chunk<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    chunk(bytes, at).map(u32::from_le_bytes)
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    chunk(bytes, at).map(u16::from_le_bytes)
}

impl<'a> Table<'a> {
    /// The root table of a buffer without its length, which must have this identifier.
    pub fn root(bytes: &'a [u8], identifier: &[u8; 4]) -> Option<Self> {
        if chunk::<4>(bytes, 4)? != *identifier {
            return None;
        }
        Self::at(bytes, u32_at(bytes, 0)? as usize)
    }

    fn at(bytes: &'a [u8], at: usize) -> Option<Self> {
        let back = i64::from(chunk(bytes, at).map(i32::from_le_bytes)?);
        let fields = usize::try_from(i64::try_from(at).ok()? - back).ok()?;
        let fields_length = usize::from(u16_at(bytes, fields)?);
        Some(Self { bytes, at, fields, fields_length })
    }

    /// Where the field lies; `None` if it is not there and has its default.
    fn field(&self, index: usize) -> Option<usize> {
        let entry = 4 + 2 * index;
        if entry + 2 > self.fields_length {
            return None;
        }
        match u16_at(self.bytes, self.fields.checked_add(entry)?)? {
            0 => None,
            offset => self.at.checked_add(usize::from(offset)),
        }
    }

    /// The bytes of a scalar field.
    pub fn scalar<const N: usize>(&self, index: usize) -> Option<[u8; N]> {
        chunk(self.bytes, self.field(index)?)
    }

    /// A field of type `int64`, 0 without it.
    pub fn i64(&self, index: usize) -> i64 {
        self.scalar(index).map_or(0, i64::from_le_bytes)
    }

    /// A field of type `int16`, 0 without it.
    pub fn i16(&self, index: usize) -> i16 {
        self.scalar(index).map_or(0, i16::from_le_bytes)
    }

    /// A field of type `int8`, 0 without it.
    pub fn i8(&self, index: usize) -> i8 {
        self.scalar(index).map_or(0, i8::from_le_bytes)
    }

    /// A field of type `float`, 0 without it.
    pub fn f32(&self, index: usize) -> f32 {
        self.scalar(index).map_or(0.0, f32::from_le_bytes)
    }

    /// The vector of a field: where its elements begin, and how many there are.
    fn vector(&self, index: usize) -> Option<(usize, usize)> {
        let at = self.field(index)?;
        let at = at.checked_add(u32_at(self.bytes, at)? as usize)?;
        Some((at.checked_add(4)?, u32_at(self.bytes, at)? as usize))
    }

    /// The elements of a vector of structures of `N` bytes; `None` if they do not lie in the buffer.
    pub fn structures<const N: usize>(&self, index: usize) -> Option<&'a [[u8; N]]> {
        let Some((at, count)) = self.vector(index) else { return Some(&[]) };
        let bytes = self.bytes.get(at..at.checked_add(count.checked_mul(N)?)?)?;
        Some(bytes.as_chunks().0)
    }

    /// The bytes of a vector or a string.
    pub fn bytes(&self, index: usize) -> Option<&'a [u8]> {
        self.structures::<1>(index).map(|bytes| bytes.as_flattened())
    }

    /// The tables of a vector of tables, each `None` if it does not lie in the buffer.
    pub fn tables(&self, index: usize) -> Option<impl Iterator<Item = Option<Table<'a>>> + 'a> {
        let offsets = self.structures::<4>(index)?;
        let (bytes, first) = (self.bytes, self.vector(index).map_or(0, |vector| vector.0));
        Some(offsets.iter().enumerate().map(move |(number, offset)| {
            let at = first + 4 * number;
            Self::at(bytes, at.checked_add(u32::from_le_bytes(*offset) as usize)?)
        }))
    }
}

/// Lays a buffer out from front to back, its length first.
#[derive(Debug)]
pub(super) struct Layout {
    pub bytes: Vec<u8>,
}

impl Layout {
    /// A buffer with this identifier whose root table has these fields: offset in the table of each, 0 where it is not
    /// there. The table's `size` counts from its own offset to the fields on; it begins at an address that is 4 more
    /// than a multiple of 8, so that a field at offset 4 is aligned for 8 bytes.
    pub fn new(identifier: &[u8; 4], fields: &[u16], size: u16) -> (Self, usize) {
        let mut layout = Self { bytes: vec![0; 8] };
        layout.bytes.extend(identifier);
        let table = layout.table(fields, size);
        let root = (table - 4) as u32;
        layout.bytes[4..8].copy_from_slice(&root.to_le_bytes());
        (layout, table)
    }

    /// Appends the description of a table's fields, then the table, with all fields zero.
    fn table(&mut self, fields: &[u16], size: u16) -> usize {
        // Fields' description and table touch; the table lies 4 beyond a multiple of 8.
        let description = 4 + 2 * fields.len();
        while (self.bytes.len() + description) % 8 != 4 {
            self.bytes.push(0);
        }
        let at = self.bytes.len();
        self.u16(description as u16);
        self.u16(size);
        fields.iter().for_each(|&field| self.u16(field));
        let table = self.bytes.len();
        self.bytes.extend(((table - at) as i32).to_le_bytes());
        self.bytes.resize(table + usize::from(size), 0);
        table
    }

    fn u16(&mut self, value: u16) {
        self.bytes.extend(value.to_le_bytes());
    }

    /// Writes a scalar into a table.
    pub fn set<const N: usize>(&mut self, table: usize, offset: u16, value: [u8; N]) {
        let at = table + usize::from(offset);
        self.bytes[at..at + N].copy_from_slice(&value);
    }

    /// Begins a vector of `count` elements, of `alignment` bytes, that the field at `offset` of `table` refers to.
    pub fn vector(&mut self, table: usize, offset: u16, count: usize, alignment: usize) {
        while !(self.bytes.len() + 4).is_multiple_of(alignment) || !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let from = table + usize::from(offset);
        let distance = (self.bytes.len() - from) as u32;
        self.set(table, offset, distance.to_le_bytes());
        self.bytes.extend((count as u32).to_le_bytes());
    }

    /// Appends `count` tables with the same fields and the references to them that a vector holds; gives their places.
    pub fn tables(&mut self, count: usize, fields: &[u16], size: u16) -> Vec<usize> {
        let references = self.bytes.len();
        self.bytes.resize(references + 4 * count, 0);
        let places: Vec<usize> = (0..count).map(|_| self.table(fields, size)).collect();
        for (number, &place) in places.iter().enumerate() {
            let at = references + 4 * number;
            self.bytes[at..at + 4].copy_from_slice(&((place - at) as u32).to_le_bytes());
        }
        places
    }

    /// The buffer, its length (which does not count itself) filled in.
    pub fn finish(mut self) -> Vec<u8> {
        let length = (self.bytes.len() - 4) as u32;
        self.bytes[..4].copy_from_slice(&length.to_le_bytes());
        self.bytes
    }
}
