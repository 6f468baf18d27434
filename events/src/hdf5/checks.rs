//! What a file says of its events beyond their columns, and whether it can be believed.

use hdf5::{
    Dataset, Group, Location,
    types::{CompoundType, TypeDescriptor},
};

use crate::SensorSize;

/// What is wrong where a name says something of times that is not understood.
fn not_understood(mut names: impl Iterator<Item = String>) -> Result<(), String> {
    let is_of_times = |name: &String| {
        let name = name.to_lowercase();
        name.starts_with("t_") || name.contains("unit") || name.contains("offset")
    };
    names.find(is_of_times).map_or(Ok(()), |name| {
        Err(format!(
            "`{}` says something of times that is not understood; write `t` as integers in microseconds with that taken in, and \
             remove it",
            name.escape_debug()
        ))
    })
}

/// Refuses what DSEC's layout does not have beside its times and that may change them.
pub(super) fn times(file: &Group, events: &Group) -> Result<(), String> {
    let t = events.dataset("t").map_err(|error| error.to_string())?;
    let at_root = file.member_names().unwrap_or_default().into_iter().filter(|name| name != "t_offset");
    let within = events.member_names().unwrap_or_default();
    not_understood(at_root.chain(within).chain(attributes(file)).chain(attributes(events)).chain(attributes(&t)))
}

/// Names of attributes, but of those that say microseconds.
fn attributes(of: &Location) -> Vec<String> {
    let says_us = |name: &String| {
        let text = super::read::text(of, name);
        text.is_some_and(|text| {
            ["us", "µs", "usec", "microsecond", "microseconds"].contains(&text.to_lowercase().trim())
        })
    };
    of.attr_names().unwrap_or_default().into_iter().filter(|name| !says_us(name)).collect()
}

/// The size of a sensor from `WIDTHxHEIGHT`.
pub(super) fn geometry(text: &str) -> Result<SensorSize, String> {
    let side = |text: &str| text.trim().parse().ok();
    let sides = text.trim().split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    let (width, height) = sides
        .ok_or_else(|| format!("its attribute geometry is `{}`, and WIDTHxHEIGHT is needed", text.escape_debug()))?;
    Ok(SensorSize { width, height })
}

/// Refuses a dataset that says to have more elements than it has stored: the rest would be made up, for as long as the number goes.
pub(super) fn stored(name: &str, dataset: &Dataset) -> Result<(), String> {
    let length = dataset.size() as u64;
    let stored = match dataset.chunk() {
        Some(shape) => {
            let each = shape.iter().fold(1_u64, |all, &side| all.saturating_mul(side as u64));
            each.saturating_mul(dataset.num_chunks().unwrap_or(0) as u64)
        }
        None => dataset.storage_size() / (dataset.dtype().map_or(1, |kind| kind.size()).max(1) as u64),
    };
    if stored < length {
        return Err(format!("{name} says to have {length} elements and stores {stored}; write the file again"));
    }
    Ok(())
}

/// Refuses records that lack a field, which would be read as zeros, or have one as another kind of number.
pub(super) fn fields(name: &str, dataset: &Dataset, needed: &[&str]) -> Result<(), String> {
    let kind = dataset.dtype().and_then(|kind| kind.to_descriptor()).map_err(|error| error.to_string())?;
    let TypeDescriptor::Compound(CompoundType { fields, .. }) = kind else {
        return Err(format!("{name} holds {kind}, and records of {} are needed", needed.join(", ")));
    };
    let is_whole = |kind: &TypeDescriptor| {
        matches!(kind, TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_) | TypeDescriptor::Boolean)
    };
    for needed in needed {
        match fields.iter().find(|field| field.name == *needed) {
            Some(field) if is_whole(&field.ty) => {}
            Some(field) => return Err(format!("the field `{needed}` of {name} is of {}, and no integer", field.ty)),
            None => {
                let found: Vec<_> = fields.iter().map(|field| field.name.escape_debug().to_string()).collect();
                return Err(format!("the records of {name} have {}, and no `{needed}`", found.join(", ")));
            }
        }
    }
    not_understood(fields.into_iter().map(|field| field.name).chain(attributes(dataset)))
}
