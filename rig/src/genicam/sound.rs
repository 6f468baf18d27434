//! What a description must not be: nodes that take their value from themselves, by whatever way, or over so many others that the
//! library which follows them runs out of stack; and formulas nested as deep. A camera says what it likes.

use std::collections::{BTreeMap, VecDeque};

use viva_genapi_xml::{
    AddressTerm, Addressing, CommandValueSrc, EnumValueSrc, IndexOffset, IndexedValue, NodeDecl, XmlModel,
};

/// A value comes over fewer nodes than this; descriptions of cameras have some ten.
const MOST_STEPS: usize = 100;
/// What formulas of cameras do not come near.
const MOST_NESTED: usize = 64;
const MOST_OPERATORS: usize = 2000;

/// Looks for what the library cannot follow: says which node it is.
pub fn problem(model: &XmlModel) -> Option<String> {
    let formulas = model.nodes.iter().flat_map(|node| formulas(node).into_iter().map(|text| (node.name(), text)));
    let deep = |(_, text): &(&str, &str)| is_deep(text);
    if let Some((name, _)) = formulas.into_iter().find(deep) {
        return Some(format!("the formula of {name:?} is nested deeper than any camera's"));
    }
    too_far(model)
        .map(|name| format!("the value of {name:?} comes from itself, or over more than {MOST_STEPS} other nodes"))
}

/// Whether a formula would take more stack than there is, taken apart or evaluated.
fn is_deep(formula: &str) -> bool {
    let mut nested: usize = 0;
    let mut operators: usize = 0;
    let mut signs: usize = 0;
    for byte in formula.bytes().filter(|byte| !byte.is_ascii_whitespace()) {
        match byte {
            b'(' => nested += 1,
            b')' => nested = nested.saturating_sub(1),
            _ => {}
        }
        let sign = !byte.is_ascii_alphanumeric() && !b"_.()".contains(&byte);
        signs = if sign { signs + 1 } else { 0 };
        operators += usize::from(sign);
        if nested > MOST_NESTED || signs > MOST_NESTED || operators > MOST_OPERATORS {
            return true;
        }
    }
    false
}

fn formulas(node: &NodeDecl) -> Vec<&str> {
    match node {
        NodeDecl::SwissKnife(knife) => {
            let more = knife.bindings.expressions.iter().map(|(_, text)| text.as_str());
            more.chain([knife.expr.as_str()]).collect()
        }
        NodeDecl::Converter(converter) => {
            let more = converter.bindings.expressions.iter().map(|(_, text)| text.as_str());
            more.chain([converter.formula_to.as_str(), &converter.formula_from]).collect()
        }
        NodeDecl::IntConverter(converter) => {
            let more = converter.bindings.expressions.iter().map(|(_, text)| text.as_str());
            more.chain([converter.formula_to.as_str(), &converter.formula_from]).collect()
        }
        _ => Vec::new(),
    }
}

/// A node that is part of a ring, or too far from where its value comes from. Nodes are taken away once all that they need are.
fn too_far(model: &XmlModel) -> Option<&str> {
    let index: BTreeMap<&str, usize> = model.nodes.iter().enumerate().map(|(at, node)| (node.name(), at)).collect();
    let mut needed_by: Vec<Vec<usize>> = vec![Vec::new(); model.nodes.len()];
    let mut open = vec![0_usize; model.nodes.len()];
    for (at, node) in model.nodes.iter().enumerate() {
        for source in sources(node).into_iter().filter_map(|name| index.get(name)) {
            needed_by[*source].push(at);
            open[at] += 1;
        }
    }
    let mut steps = vec![0_usize; model.nodes.len()];
    let mut ready: VecDeque<usize> = (0..open.len()).filter(|&at| open[at] == 0).collect();
    let mut taken = vec![false; model.nodes.len()];
    while let Some(at) = ready.pop_front() {
        taken[at] = steps[at] <= MOST_STEPS;
        for &next in &needed_by[at] {
            steps[next] = steps[next].max(steps[at] + 1);
            open[next] -= 1;
            if open[next] == 0 {
                ready.push_back(next);
            }
        }
    }
    taken.iter().position(|taken| !taken).map(|at| model.nodes[at].name())
}

/// The nodes that a node's value is read through.
fn sources(node: &NodeDecl) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    match node {
        NodeDecl::Integer { addressing, pvalue, indexed, .. } => {
            names.extend(pvalue.as_deref());
            names.extend(indexed.iter().flat_map(of_table));
            names.extend(addressing.iter().flat_map(of_address));
        }
        NodeDecl::Float { addressing, pvalue, indexed, .. } => {
            names.extend(pvalue.as_deref());
            names.extend(indexed.iter().flat_map(of_table));
            names.extend(addressing.iter().flat_map(of_address));
        }
        NodeDecl::Enum { addressing, pvalue, entries, .. } => {
            names.extend(pvalue.as_deref());
            names.extend(entries.iter().filter_map(|entry| match &entry.value {
                EnumValueSrc::FromNode(name) => Some(name.as_str()),
                EnumValueSrc::Literal(_) => None,
            }));
            names.extend(addressing.iter().flat_map(of_address));
        }
        NodeDecl::Boolean { addressing, pvalue, .. } => {
            names.extend(pvalue.as_deref());
            names.extend(addressing.iter().flat_map(of_address));
        }
        NodeDecl::Command { pvalue, command_value, .. } => {
            names.extend(pvalue.as_deref());
            if let CommandValueSrc::FromNode(name) = command_value {
                names.push(name);
            }
        }
        NodeDecl::SwissKnife(knife) => names.extend(knife.variables.iter().map(|(_, name)| name.as_str())),
        NodeDecl::Converter(converter) => {
            names.push(&converter.p_value);
            let variables = converter.variables_to.iter().chain(&converter.variables_from);
            names.extend(variables.map(|(_, name)| name.as_str()));
        }
        NodeDecl::IntConverter(converter) => {
            names.push(&converter.p_value);
            let variables = converter.variables_to.iter().chain(&converter.variables_from);
            names.extend(variables.map(|(_, name)| name.as_str()));
        }
        NodeDecl::String(string) => {
            names.extend(string.pvalue.as_deref());
            names.extend(string.addressing.iter().flat_map(of_address));
        }
        NodeDecl::Register(register) => names.extend(of_address(&register.addressing)),
        _ => {}
    }
    names
}

fn of_table<T>(table: &IndexedValue<T>) -> Vec<&str> {
    let mut names = table.value_nodes();
    names.push(&table.index);
    names
}

fn of_address(addressing: &Addressing) -> Vec<&str> {
    let Addressing::Sum { terms, p_length, .. } = addressing;
    let mut names: Vec<&str> = p_length.as_deref().into_iter().collect();
    for term in terms {
        match term {
            AddressTerm::Fixed(_) => {}
            AddressTerm::Node(name) => names.push(name),
            AddressTerm::Index { node, offset } => {
                names.push(node);
                if let IndexOffset::Node(name) = offset {
                    names.push(name);
                }
            }
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(nodes: &str) -> Option<String> {
        let xml = format!(
            "<RegisterDescription SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\">{nodes}\
             </RegisterDescription>"
        );
        problem(&viva_genapi_xml::parse(&xml).unwrap())
    }

    fn knife(name: &str, variable: &str, formula: &str) -> String {
        format!(
            "<IntSwissKnife Name=\"{name}\"><pVariable Name=\"X\">{variable}</pVariable><Formula>{formula}</Formula>\
             </IntSwissKnife>"
        )
    }

    #[test]
    fn values_that_come_from_themselves_are_told() {
        let link = |name: &str, of: &str| format!("<Integer Name=\"{name}\"><pValue>{of}</pValue></Integer>");
        let end = "<Integer Name=\"End\"><Value>1</Value></Integer>";
        assert_eq!(of(&[&link("A", "B"), &link("B", "End"), end].concat()), None);
        let message = of(&[link("A", "B"), link("B", "A")].concat()).unwrap();
        assert!(message.contains("\"A\" comes from itself"), "{message}");
        assert!(of(&[link("A", "K"), knife("K", "A", "X + 1")].concat()).is_some());
        let chain = |count: usize| {
            let links = (0..count).map(|at| link(&format!("N{at}"), &format!("N{}", at + 1)));
            let last = link(&format!("N{count}"), "End");
            of(&[&links.collect::<String>(), &last, end].concat())
        };
        assert_eq!((chain(50), chain(200).is_some()), (None, true));
    }

    #[test]
    fn formulas_that_are_nested_too_deep_are_told() {
        let end = "<Integer Name=\"End\"><Value>1</Value></Integer>";
        let formula = |text: &str| of(&[&knife("K", "End", text), end].concat());
        assert_eq!(formula("(X &gt; 3) ? ((X * 2) + 1) : -X"), None);
        let message = formula(&format!("{}X{}", "(".repeat(5000), ")".repeat(5000))).unwrap();
        assert!(message.contains("formula of \"K\""), "{message}");
        assert!(formula(&format!("{}X", "-".repeat(5000))).is_some());
        assert!(formula(&format!("X{}", " + 1".repeat(5000))).is_some());
    }
}
