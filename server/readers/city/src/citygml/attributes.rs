//! Attributes of an object: simple properties, generic attributes, addresses and properties of extensions.

use super::codelists::Codelists;
use super::names::{Class, Family, GenericType, Names};
use super::tree::{AttributeKind, Tree};
use insula_dress::footprint::is_height;
use insula_source::attributes::{AttributeValue, Attributes, MAX_ATTRIBUTES};
use insula_source::units::metres_of;
use std::collections::HashMap;

/// Reads the attributes of one object.
pub(super) struct AttributeReader<'r, 'f> {
    pub(super) tree: &'r Tree,
    pub(super) names: &'r Names,
    pub(super) codelists: &'r mut Codelists<'f>,
    pub(super) attributes: Attributes,
}

impl AttributeReader<'_, '_> {
    /// The attributes of the object at `node`.
    pub(super) fn read(mut self, node: u32) -> Attributes {
        let mut counts: HashMap<&str, u32> = HashMap::new();
        let tree = self.tree;
        for property in tree.children(node) {
            if self.attributes.len() >= MAX_ATTRIBUTES {
                break;
            }
            let local = self.names.local(tree.node(property).name);
            match tree.class(self.names, property) {
                Class::Generic(kind) => self.add_generic(property, kind, ""),
                Class::GenericProperty => self.add_generic_property(property, ""),
                class @ (Class::Other | Class::ReliefLod | Class::Address) => {
                    let count = counts.entry(local).or_default();
                    let name = if *count == 0 { local.to_owned() } else { format!("{local}.{count}") };
                    *count += 1;
                    if class == Class::Address {
                        self.add_address(property, &name);
                    } else {
                        self.add_property(property, &name);
                    }
                }
                _ => {}
            }
        }
        // The height of CityGML 3.0 is one of several between named references.
        if let Some(height) = self.attributes.get("height.value").cloned() {
            let unit = self.attributes.get("height.value.uom").and_then(AttributeValue::as_str).map(str::to_owned);
            self.push_height("measuredHeight", height, unit.as_deref());
        }
        self.attributes
    }

    /// Adds a property, or the properties within it. Names of types between properties are left out.
    fn add_property(&mut self, property: u32, name: &str) {
        let tree = self.tree;
        if tree.is_leaf(property) {
            return self.add_simple(property, name);
        }
        if self.attributes.len() >= MAX_ATTRIBUTES {
            return;
        }
        let mut counts: HashMap<&str, u32> = HashMap::new();
        for child in tree.children(property) {
            let own = self.names.get(tree.node(child).name);
            match own.class {
                Class::Generic(kind) => self.add_generic(child, kind, &format!("{name}.")),
                Class::GenericProperty => self.add_generic_property(child, &format!("{name}.")),
                // Geometry of extensions has no attributes.
                Class::Other if own.family == Family::Gml && is_type(&own.local) => {}
                Class::Other if is_type(&own.local) => self.add_property(child, name),
                Class::Other | Class::ReliefLod => {
                    let count = counts.entry(&*own.local).or_default();
                    let local = &own.local;
                    let name = if *count == 0 { format!("{name}.{local}") } else { format!("{name}.{local}.{count}") };
                    *count += 1;
                    self.add_property(child, &name);
                }
                _ => {}
            }
        }
    }

    fn add_simple(&mut self, property: u32, name: &str) {
        let tree = self.tree;
        let Some(text) = tree.text_of(property) else { return };
        if let Some(code_space) = tree.attribute(property, AttributeKind::CodeSpace) {
            let value = self.codelists.name_of(code_space, text).unwrap_or(text);
            return self.attributes.push(name, AttributeValue::Text(value.to_owned()));
        }
        let local = self.names.local(tree.node(property).name);
        let value = match local {
            "name" | "description" | "identifier" => AttributeValue::Text(text.to_owned()),
            _ => AttributeValue::from_untyped(text),
        };
        self.push_measure(property, name, value);
    }

    /// Adds a value with its unit, unless that is the metre. Heights in other units become metres.
    fn push_measure(&mut self, property: u32, name: &str, value: AttributeValue) {
        let unit = self.tree.attribute(property, AttributeKind::Uom);
        let unit = unit.filter(|unit| !unit.trim_start_matches('#').is_empty() && metres_of(unit) != Some(1.0));
        self.push_height(name, value, unit);
    }

    /// Adds a value that may be a height in a unit, which becomes metres if it is known. Others keep their unit beside them.
    fn push_height(&mut self, name: &str, value: AttributeValue, unit: Option<&str>) {
        match (unit, value.as_f64(), unit.and_then(metres_of)) {
            (Some(_), Some(value), Some(unit_m)) if is_height(name) => {
                self.attributes.push(name, AttributeValue::Float(value * unit_m));
            }
            (Some(unit), ..) => {
                self.attributes.push(name, value);
                self.attributes.push(&format!("{name}.uom"), AttributeValue::Text(unit.to_owned()));
            }
            (None, ..) => self.attributes.push(name, value),
        }
    }

    fn add_generic_property(&mut self, property: u32, prefix: &str) {
        let tree = self.tree;
        for child in tree.children(property) {
            if let Class::Generic(kind) = tree.class(self.names, child) {
                self.add_generic(child, kind, prefix);
            }
        }
    }

    fn add_generic(&mut self, node: u32, kind: GenericType, prefix: &str) {
        let tree = self.tree;
        let named = |local| tree.child_named(self.names, node, local);
        let of_child = || named("name").and_then(|name| tree.text_of(name));
        let Some(name) = tree.attribute(node, AttributeKind::Name).or_else(of_child).filter(|name| !name.is_empty())
        else {
            return;
        };
        let name = format!("{prefix}{name}");
        if kind == GenericType::Set {
            let prefix = format!("{name}.");
            for child in tree.children(node) {
                match tree.class(self.names, child) {
                    Class::Generic(kind) => self.add_generic(child, kind, &prefix),
                    Class::GenericProperty => self.add_generic_property(child, &prefix),
                    _ => {}
                }
            }
            return;
        }
        let Some(value) = named("value") else { return };
        let Some(text) = tree.text_of(value) else { return };
        if let Some(code_space) = tree.attribute(value, AttributeKind::CodeSpace) {
            let text = self.codelists.name_of(code_space, text).unwrap_or(text).to_owned();
            return self.attributes.push(&name, AttributeValue::Text(text));
        }
        let parsed = match kind {
            GenericType::Integer => text.parse().ok().map(AttributeValue::Integer),
            GenericType::Float => text.parse().ok().map(AttributeValue::Float),
            GenericType::Date => AttributeValue::date(text),
            GenericType::Text | GenericType::Set => None,
        };
        self.push_measure(value, &name, parsed.unwrap_or_else(|| AttributeValue::Text(text.to_owned())));
    }

    fn add_address(&mut self, address: u32, prefix: &str) {
        self.add_address_parts(address, None, prefix);
    }

    fn add_address_parts(&mut self, node: u32, parent: Option<&str>, prefix: &str) {
        let tree = self.tree;
        let local = self.names.local(tree.node(node).name);
        if let (Some(text), Some(parent)) = (tree.text_of(node), parent) {
            let name = format!("{prefix}.{}", address_name(local, parent));
            return self.attributes.push(&name, AttributeValue::Text(text.to_owned()));
        }
        for child in tree.children(node) {
            if !matches!(tree.class(self.names, child), Class::Lines | Class::LodLines | Class::Ignored) {
                self.add_address_parts(child, Some(local), prefix);
            }
        }
    }
}

/// Whether a name is of a type and not of a property.
fn is_type(local: &str) -> bool {
    local.starts_with(char::is_uppercase)
}

/// The name of a part of an address: `thoroughfare` for `Thoroughfare/NameElement` and for `ThoroughfareName`.
fn address_name(local: &str, parent: &str) -> String {
    let name = match local {
        "NameElement" | "Identifier" | "Name" => parent.to_owned(),
        "Number" => format!("{parent}Number"),
        local => local.strip_suffix("Name").unwrap_or(local).to_owned(),
    };
    let mut letters = name.chars();
    letters.next().map_or(String::new(), |first| first.to_lowercase().chain(letters).collect())
}
