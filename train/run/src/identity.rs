//! What makes two runs the same run: the data, the settings, and the program.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

/// What a run is a run of. Wherever and however often it is started, it comes to the same.
#[derive(Clone, Debug, PartialEq)]
pub struct Identity {
    /// SHA-256 of the dataset's manifest.
    pub dataset_sha256: String,
    /// The effective configuration, as `config.toml` has it.
    pub config: toml::Table,
    /// Seconds of training and of CPU time that the schedule follows, where it does.
    pub budget: [Option<f64>; 2],
    /// Version of erfgs.
    pub version: String,
}

impl Identity {
    /// SHA-256 (hexadecimal) of all that.
    #[must_use]
    pub fn sha256(&self) -> String {
        let mut hasher = Sha256::new();
        // Every part ends where no part can go on.
        let mut take = |text: &str| {
            hasher.update(text.as_bytes());
            hasher.update([0]);
        };
        take(&self.version);
        take(&self.dataset_sha256);
        take(&format!("{:?}", self.budget));
        for (key, value) in flat(&self.config) {
            take(&key);
            take(&value);
        }
        hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// What is not as in a run that was begun with `other`, a line each; nothing where only the program is another.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let (ours, theirs) = (flat(&self.config), flat(&other.config));
        let of = |settings: &BTreeMap<String, String>, key: &str| {
            settings.get(key).map_or_else(|| "not set".to_owned(), Clone::clone)
        };
        let keys: std::collections::BTreeSet<&String> = ours.keys().chain(theirs.keys()).collect();
        let mut found: Vec<String> = keys
            .into_iter()
            .filter(|key| ours.get(*key) != theirs.get(*key))
            .map(|key| format!("{key} is {} here, and {} in the run", of(&ours, key), of(&theirs, key)))
            .collect();
        let budget = |seconds: Option<f64>| {
            seconds.map_or_else(|| "not limited".to_owned(), |seconds| format!("{} minutes", seconds / 60.0))
        };
        for (what, (ours, theirs)) in ["time", "CPU time"].into_iter().zip(std::iter::zip(self.budget, other.budget)) {
            if ours != theirs {
                found.push(format!(
                    "the {what} of training is {} here, and {} in the run",
                    budget(ours),
                    budget(theirs)
                ));
            }
        }
        found
    }
}

/// The fields of a configuration by their dotted names, their values as text.
#[must_use]
pub fn flat(config: &toml::Table) -> BTreeMap<String, String> {
    fn walk(prefix: &str, table: &toml::Table, found: &mut BTreeMap<String, String>) {
        for (key, value) in table {
            let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            match value {
                toml::Value::Table(inner) => walk(&key, inner, found),
                toml::Value::Float(number) => drop(found.insert(key, float(*number))),
                other => drop(found.insert(key, other.to_string())),
            }
        }
    }
    let mut found = BTreeMap::new();
    walk("", config, &mut found);
    found
}

/// Single-precision fields come as their nearest double: shows what was meant.
fn float(value: f64) -> String {
    let single = value as f32;
    if (f64::from(single) - value).abs() <= value.abs() * 1e-12 { format!("{single:?}") } else { format!("{value:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identity(config: &str) -> Identity {
        Identity {
            dataset_sha256: "ab".into(),
            config: config.parse().unwrap(),
            budget: [None, Some(60.0)],
            version: "1".into(),
        }
    }

    #[test]
    fn nested_tables_become_dotted_keys_and_single_precision_reads_as_meant() {
        let found = flat(&"a = 1\n[b]\nc = 0.10000000149011612\n[b.d]\ne = [1, 2]\n".parse().unwrap());
        let found: Vec<String> = found.into_iter().map(|(key, value)| format!("{key}={value}")).collect();
        assert_eq!(found, ["a=1", "b.c=0.1", "b.d.e=[1, 2]"]);
    }

    #[test]
    fn every_part_counts_and_the_order_of_settings_does_not() {
        let one = identity("a = 1\n[b]\nc = 2\n");
        assert_eq!(one.sha256().len(), 64);
        assert_eq!(one.sha256(), identity("b.c = 2\na = 1\n").sha256());
        let others = [
            identity("a = 1\n[b]\nc = 3\n"),
            Identity { dataset_sha256: "ac".into(), ..one.clone() },
            Identity { budget: [Some(60.0), None], ..one.clone() },
            Identity { version: "2".into(), ..one.clone() },
        ];
        for other in &others {
            assert_ne!(one.sha256(), other.sha256(), "{other:?}");
        }
    }

    #[test]
    fn differences_name_the_setting_and_both_values() {
        let other = Identity { budget: [None, None], ..identity("a = 2\n") };
        assert_eq!(
            identity("a = 1\nb = 'x'\n").differences(&other),
            [
                "a is 1 here, and 2 in the run",
                "b is \"x\" here, and not set in the run",
                "the CPU time of training is 1 minutes here, and not limited in the run"
            ]
        );
    }
}
