//! The extension 3DTILES_batch_table_hierarchy: features are instances of classes and inherit the attributes of parents.

use super::batch_column::Column;
use insula_source::attributes::Attributes;
use serde_json::Value;

/// Parents, grandparents and so on of which a feature inherits attributes.
const MAX_ANCESTORS: usize = 64;

/// Classes, instances and parents.
#[derive(Debug)]
pub(super) struct Hierarchy<'a> {
    classes: Vec<Class<'a>>,
    /// Class of each instance and the row in it.
    instances: Vec<(u32, u32)>,
    /// Where the parents of each instance start in `parents`, and the end.
    parent_starts: Vec<u32>,
    parents: Vec<u32>,
}

#[derive(Debug)]
struct Class<'a> {
    name: String,
    columns: Vec<(String, Column<'a>)>,
}

impl<'a> Hierarchy<'a> {
    /// Fails if the members that make the hierarchy are malformed. Columns that are malformed are left out.
    pub(super) fn new(json: &Value, binary: &'a [u8]) -> Result<Self, &'static str> {
        let count = |json: &Value, name: &str| {
            let count = json.get(name).and_then(Value::as_u64);
            count.and_then(|count| u32::try_from(count).ok())
        };
        let length = count(json, "instancesLength").ok_or("instancesLength is missing")?;
        let list = json.get("classes").and_then(Value::as_array).ok_or("classes are missing")?;
        let classes = list.iter().map(|class| {
            let length = count(class, "length").unwrap_or(0);
            let members = class.get("instances").and_then(Value::as_object);
            let columns = members.into_iter().flatten().filter_map(|(name, value)| {
                Column::new(value, binary, length).ok().map(|column| (name.clone(), column))
            });
            let name = class.get("name").and_then(Value::as_str).unwrap_or_default().to_owned();
            Class { name, columns: columns.collect() }
        });
        let classes: Vec<_> = classes.collect();
        let column = |name: &str, length: u32| match json.get(name) {
            Some(value) => Column::new(with_type(value).as_ref().unwrap_or(value), binary, length).map(Some),
            None => Ok(None),
        };
        let class_ids = column("classIds", length)?.ok_or("classIds are missing")?;
        let mut rows = vec![0_u32; classes.len()];
        let mut instances = Vec::new();
        // Ends with the values, which exist, not with the length, which is only claimed.
        for class in (0..length as usize).map_while(|i| class_ids.index_at(i)) {
            let row = rows.get_mut(class as usize).ok_or("a class does not exist")?;
            instances.push((class, *row));
            *row += 1;
        }
        let parent_counts = column("parentCounts", length)?;
        let mut parent_starts = vec![0_u32];
        for i in 0..instances.len() {
            let count = match &parent_counts {
                Some(counts) => counts.index_at(i).ok_or("parentCounts are too few")?,
                None => 1,
            };
            let start = parent_starts.last().copied().unwrap_or(0);
            parent_starts.push(start.checked_add(count).ok_or("parentCounts are too large")?);
        }
        let total = parent_starts.last().copied().unwrap_or(0);
        let parents = match column("parentIds", total)? {
            Some(ids) => (0..total as usize).map_while(|i| ids.index_at(i)).collect(),
            None => Vec::new(),
        };
        Ok(Self { classes, instances, parent_starts, parents })
    }

    /// Adds the attributes of an instance, then those of its parents. Returns the name of its class.
    pub(super) fn add_to(&self, instance: u32, into: &mut Attributes) -> Option<&str> {
        let own_class = self.class_of(instance)?.0;
        let mut waiting = vec![instance];
        let mut done = Vec::new();
        while let Some(instance) = waiting.pop() {
            if done.len() >= MAX_ANCESTORS || done.contains(&instance) {
                continue;
            }
            done.push(instance);
            let Some((class, row)) = self.class_of(instance) else { continue };
            for (name, column) in &class.columns {
                column.add_to(name, row as usize, into);
            }
            let i = instance as usize;
            let range = self.parent_starts.get(i).zip(self.parent_starts.get(i + 1));
            let parents = range.and_then(|(start, end)| self.parents.get(*start as usize..*end as usize));
            // The first parent is the last to be put on the stack, so that it comes first. An instance without a parent is
            // its own.
            waiting.extend(parents.unwrap_or_default().iter().rev().take(MAX_ANCESTORS));
        }
        Some(own_class.name.as_str()).filter(|name| !name.is_empty())
    }

    fn class_of(&self, instance: u32) -> Option<(&Class<'a>, u32)> {
        let (class, row) = *self.instances.get(instance as usize)?;
        Some((self.classes.get(class as usize)?, row))
    }
}

/// The description of a binary list of indices with the component type that is the default for them.
fn with_type(json: &Value) -> Option<Value> {
    let members = json.as_object().filter(|members| !members.contains_key("componentType"))?;
    let mut members = members.clone();
    members.insert("componentType".to_owned(), "UNSIGNED_SHORT".into());
    Some(Value::Object(members))
}
