//! What a camera can do, by its own description (GenApi). This file and `sound` alone know the library which evaluates it.

use std::fmt::Display;

use bytes::Bytes;
use viva_genapi::{AccessMode, ChunkData, GenApiError, Node, NodeMap, RegisterIo};
use viva_genapi_xml::{NodeDecl, XmlModel};

use super::{GenicamError, chunks::Chunk, sound};

/// The camera's registers, wherever they are.
pub trait Registers: Send {
    /// Reads so many bytes.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    fn read(&self, address: u64, length: usize) -> Result<Vec<u8>, GenicamError>;

    /// Writes.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    fn write(&self, address: u64, data: &[u8]) -> Result<(), GenicamError>;
}

struct Io<R>(R);

impl<R: Registers> RegisterIo for Io<R> {
    fn read(&self, address: u64, length: usize) -> Result<Vec<u8>, GenApiError> {
        let bytes = self.0.read(address, length).map_err(|error| GenApiError::io(std::io::Error::other(error)))?;
        match bytes.len() == length {
            true => Ok(bytes),
            false => Err(GenApiError::io(std::io::Error::from(std::io::ErrorKind::UnexpectedEof))),
        }
    }

    fn write(&self, address: u64, data: &[u8]) -> Result<(), GenApiError> {
        self.0.write(address, data).map_err(|error| GenApiError::io(std::io::Error::other(error)))
    }
}

/// A camera's features.
pub struct Features {
    map: NodeMap,
    io: Box<dyn RegisterIo + Send>,
}

/// A failure with all that lies behind it.
fn reason(error: &dyn std::error::Error) -> String {
    let behind = std::iter::successors(error.source(), |error| error.source());
    behind.fold(error.to_string(), |text, error| {
        let more = error.to_string();
        if text.contains(&more) { text } else { format!("{text}: {more}") }
    })
}

impl Features {
    /// The features that a description tells of, behind registers.
    ///
    /// # Errors
    /// If it is no description.
    pub fn new(xml: &str, registers: impl Registers + 'static) -> Result<Self, GenicamError> {
        let unusable = |error: &dyn std::error::Error| GenicamError::Description { reason: reason(error) };
        let mut model = viva_genapi_xml::parse(xml).map_err(|error| unusable(&error))?;
        if let Some(reason) = sound::problem(&model) {
            return Err(GenicamError::Description { reason });
        }
        convert_integers(&mut model);
        let map = NodeMap::try_from_xml(model).map_err(|error| unusable(&error))?;
        Ok(Self { map, io: Box::new(Io(registers)) })
    }

    fn failed(name: &str) -> impl Fn(GenApiError) -> GenicamError {
        move |error| GenicamError::Feature { name: name.to_owned(), reason: reason(&error) }
    }

    /// Whether the camera has it, now.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.map.node(name).is_some()
            && self.map.is_implemented(name, &*self.io).unwrap_or(false)
            && self.map.is_available(name, &*self.io).unwrap_or(false)
    }

    /// Whether it can be set, now.
    #[must_use]
    pub fn is_settable(&self, name: &str) -> bool {
        self.has(name)
            && self.map.effective_access_mode(name, &*self.io).is_ok_and(|mode| !matches!(mode, AccessMode::RO))
    }

    /// The first of several names that the camera has.
    #[must_use]
    pub fn first<'n>(&self, names: &[&'n str]) -> Option<&'n str> {
        names.iter().copied().find(|name| self.has(name))
    }

    /// Its value, as a number.
    ///
    /// # Errors
    /// If it has none.
    pub fn number(&self, name: &str) -> Result<f64, GenicamError> {
        let number = match self.map.node(name) {
            Some(Node::Integer(_) | Node::IntConverter(_)) => {
                self.map.get_integer(name, &*self.io).map(|value| value as f64)
            }
            Some(Node::Boolean(_)) => self.map.get_bool(name, &*self.io).map(|value| f64::from(u8::from(value))),
            _ => self.map.get_float(name, &*self.io),
        };
        number.map_err(Self::failed(name))
    }

    /// Its value, as a whole number.
    ///
    /// # Errors
    /// If it has none.
    pub fn integer(&self, name: &str) -> Result<i64, GenicamError> {
        self.map.get_integer(name, &*self.io).map_err(Self::failed(name))
    }

    /// Its value as text, whatever it is.
    ///
    /// # Errors
    /// If it has none.
    pub fn text(&self, name: &str) -> Result<String, GenicamError> {
        self.map.get_text(name, &*self.io).map_err(Self::failed(name))
    }

    /// Its value for a recording: a number, a truth value or a text. `None` if it has none now.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<serde_json::Value> {
        match self.map.node(name)? {
            Node::Enum(_) | Node::String(_) => self.text(name).ok().map(Into::into),
            Node::Boolean(_) => self.map.get_bool(name, &*self.io).ok().map(Into::into),
            Node::Integer(_) | Node::IntConverter(_) => self.integer(name).ok().map(Into::into),
            _ => self.number(name).ok().map(Into::into),
        }
    }

    /// What it can be set to, now: least, most, and the step if it has one.
    #[must_use]
    pub fn range(&self, name: &str) -> Option<([f64; 2], Option<f64>)> {
        let range = self.map.feature_state(name, &*self.io).ok()?.range?;
        Some(([range.min, range.max], range.inc))
    }

    /// The choices that it has, now.
    #[must_use]
    pub fn choices(&self, name: &str) -> Vec<String> {
        self.map.available_enum_entries(name, &*self.io).unwrap_or_default()
    }

    /// Sets a number.
    ///
    /// # Errors
    /// If it cannot be set to that.
    pub fn set_number(&mut self, name: &str, value: f64) -> Result<(), GenicamError> {
        let set = match self.map.node(name) {
            Some(Node::Integer(_) | Node::IntConverter(_)) => {
                self.map.set_integer(name, value.round() as i64, &*self.io)
            }
            _ => self.map.set_float(name, value, &*self.io),
        };
        set.map_err(Self::failed(name))
    }

    /// Switches on or off, whether it is a truth value, a choice of `On` and `Off`, or a number.
    ///
    /// # Errors
    /// If it cannot be.
    pub fn set_flag(&mut self, name: &str, on: bool) -> Result<(), GenicamError> {
        let text = match self.map.node(name) {
            Some(Node::Enum(_)) => ["Off", "On"][usize::from(on)],
            _ => ["0", "1"][usize::from(on)],
        };
        self.set_text(name, text)
    }

    /// Sets a value or a choice as text.
    ///
    /// # Errors
    /// If it cannot be; with the choices, if it has some.
    pub fn set_text(&mut self, name: &str, text: &str) -> Result<(), GenicamError> {
        self.map.set_text(name, text, &*self.io).map_err(|error| {
            let mut reason = reason(&error);
            if matches!(self.map.node(name), Some(Node::Enum(_))) {
                reason += &format!("; it has {}", self.choices(name).join(", "));
            }
            GenicamError::Feature { name: name.to_owned(), reason }
        })
    }

    /// Runs a command.
    ///
    /// # Errors
    /// If there is none of this name, or the camera does not take it.
    pub fn run(&mut self, name: &str) -> Result<(), GenicamError> {
        self.map.exec_command(name, &*self.io).map_err(Self::failed(name))
    }

    /// Forgets what was read before, so that the camera is asked.
    pub fn refresh(&self) {
        self.map.invalidate_all();
    }

    /// Makes the chunks of a frame those that chunk features read.
    pub fn attach(&mut self, chunks: &[Chunk<'_>]) {
        let mut data = ChunkData::new();
        for chunk in chunks {
            data.push(chunk.id.into(), Bytes::copy_from_slice(chunk.data));
        }
        self.map.attach_chunks(&data);
    }
}

/// The library cannot read a `Float` whose `pValue` is an `Integer` (viva-genapi 0.11), as many cameras have exposure and gain: a
/// converter that changes nothing goes between.
fn convert_integers(model: &mut XmlModel) {
    let is_plain = |name: &str| name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"_.-".contains(&byte));
    let integers: std::collections::HashSet<String> = model
        .nodes
        .iter()
        .filter_map(|node| match node {
            NodeDecl::Integer { name, .. } if is_plain(name) => Some(name.clone()),
            _ => None,
        })
        .collect();
    let mut between = std::collections::BTreeSet::new();
    for node in &mut model.nodes {
        if let NodeDecl::Float { pvalue: Some(target), .. } = node
            && integers.contains(target)
        {
            between.insert(target.clone());
            *target = converter_of(target);
        }
    }
    for target in between {
        let xml = format!(
            "<RegisterDescription SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\">\
             <Converter Name=\"{}\"><FormulaTo>FROM</FormulaTo><FormulaFrom>TO</FormulaFrom><pValue>{target}</pValue>\
             </Converter></RegisterDescription>",
            converter_of(&target)
        );
        model.nodes.extend(viva_genapi_xml::parse(&xml).into_iter().flat_map(|model| model.nodes));
    }
}

fn converter_of(target: &impl Display) -> String {
    format!("{target}-as-float")
}
