//! What the end of a file says of it, and what there is instead.

use std::{
    cmp::Ordering,
    collections::BTreeMap,
    io::{Read, Seek},
};

use mcap::records::{Record, op};

use super::{
    decode::lacking,
    framing::{Framing, Head},
    layout::{Declarations, Layout},
    parse::parse_record,
    walk::{FOOTER_BYTES, Walk},
};
use crate::container::{
    ContainerError, StreamTotals,
    record::{Totals, plain_id},
};

/// What the index at the end of a file says, as far as it can be read.
#[derive(Debug, Default)]
pub(in crate::container) struct Index {
    pub declared: Declarations,
    /// How many messages each channel has.
    pub counts: Option<BTreeMap<u16, u64>>,
}

impl<R: Read + Seek> Framing<R> {
    /// Where the index starts, if the file was closed with one.
    pub fn summary_start(&mut self) -> Result<Option<u64>, ContainerError> {
        let Some(at) = self.length().checked_sub(FOOTER_BYTES) else { return Ok(None) };
        let Some(footer) = self.head_at(at, op::FOOTER)? else { return Ok(None) };
        if footer.length != 20 || !self.closed_at(footer.end())? {
            return Ok(None);
        }
        let body = self.body(&footer)?;
        let Ok(Record::Footer(footer)) = parse_record(op::FOOTER, &body) else { return Ok(None) };
        Ok((footer.summary_start > 0 && footer.summary_start < at).then_some(footer.summary_start))
    }

    /// The record at `offset`, if one of this kind lies there.
    pub fn head_at(&mut self, offset: u64, opcode: u8) -> Result<Option<Head>, ContainerError> {
        if offset >= self.length() {
            return Ok(None);
        }
        self.go_to(offset)?;
        Ok(self.head()?.filter(|head| head.opcode == opcode))
    }

    /// What the index says that lies behind the end of the data, at `at`: what the footer says of its place is wrong where
    /// something lacks before it.
    pub fn index_behind(&mut self, mut at: u64) -> Result<Index, ContainerError> {
        let mut index = Index::default();
        loop {
            self.go_to(at)?;
            let Some(head) = self.head()?.filter(|head| head.opcode != op::FOOTER) else { return Ok(index) };
            at = head.end();
            if !matches!(head.opcode, op::SCHEMA | op::CHANNEL | op::STATISTICS) {
                continue;
            }
            let body = match self.body(&head) {
                Ok(body) => body,
                Err(error @ ContainerError::Read { .. }) => return Err(error),
                Err(_) => continue,
            };
            match parse_record(head.opcode, &body) {
                Ok(Record::Schema { header, .. }) => drop(index.declared.schemas.insert(header.id, body.to_vec())),
                Ok(Record::Channel(channel)) => drop(index.declared.channels.insert(channel.id, body.to_vec())),
                Ok(Record::Statistics(statistics)) => index.counts = Some(statistics.channel_message_counts),
                _ => {}
            }
        }
    }
}

impl<R> Walk<R> {
    /// What lacks in a file that was walked over from its beginning: of a session what `totals` say, or, where it has none,
    /// the numbers of its packets; of another recording what its index `counts`.
    pub fn lacking(
        &self,
        is_session: bool,
        totals: Option<&Totals>,
        counts: Option<&BTreeMap<u16, u64>>,
    ) -> Vec<String> {
        let layout: &Layout = &self.layout;
        if let Some(totals) = totals {
            let wrong = |(id, counted): (&String, &StreamTotals)| {
                let stream = layout.streams.iter().position(|stream| stream.description.id == *id);
                if stream.is_none() && plain_id(id) != *id {
                    return None; // It has another name here.
                }
                let found = stream.and_then(|stream| self.logs.get(stream)).map_or(0, |log| log.count());
                let counted = counted.packets;
                match found.cmp(&counted) {
                    Ordering::Less => lacking(id, found, counted),
                    Ordering::Equal => None,
                    Ordering::Greater => {
                        Some(format!("stream '{id}' has {found} packets, but its end record counts {counted}"))
                    }
                }
            };
            return totals.streams.iter().filter_map(wrong).collect();
        }
        if is_session {
            let streams = layout.streams.iter().zip(&self.logs);
            let wrong = streams.filter(|(_, log)| log.unmarked() > 0).map(|(stream, log)| {
                let (id, count) = (&stream.description.id, log.unmarked());
                format!(
                    "{count} packets of stream '{id}' are missing by their sequence numbers and were not reported as lost"
                )
            });
            return wrong.collect();
        }
        let wrong = |(channel, &counted): (&u16, &u64)| {
            let found = self.counts.get(channel).copied().unwrap_or(0);
            let topic = layout.topic(*channel)?;
            (found != counted)
                .then(|| format!("{topic} has {found} messages, but the end of the file counts {counted}"))
        };
        counts.into_iter().flatten().filter_map(wrong).collect()
    }
}
