//! glTF 1.0, which old b3dm have: named items become numbered ones, shaders' diffuse values become base colours.

use super::document::{Document, check_required};
use super::schema::Root;
use insula_source::error::InputError;
use serde_json::{Map, Value, json};

/// Lists of version 2.0 that are members by name in version 1.0.
const LISTS: [&str; 10] =
    ["accessors", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "samplers", "scenes", "textures"];
/// Names of the buffer in the container.
const BINARY: [&str; 2] = ["binary_glTF", "KHR_binary_glTF"];
/// Extensions of version 1.0 that are converted.
const CONVERTED: [&str; 3] = ["KHR_binary_glTF", "KHR_materials_common", "WEB3D_quantized_attributes"];

/// Larger JSON is not converted.
const MAX_JSON_BYTES: usize = 64 << 20;

/// Whether JSON that is no version 2.0 is version 1.0.
pub(super) fn is_version_1(json: &[u8]) -> bool {
    if json.len() > MAX_JSON_BYTES {
        return false;
    }
    let Ok(value) = serde_json::from_slice::<Value>(json) else { return false };
    let version = value.pointer("/asset/version").and_then(Value::as_str).unwrap_or("");
    version.starts_with("1.") || value.get("meshes").is_some_and(Value::is_object)
}

/// Parses JSON of version 1.0. Fails if it is damaged or requires unknown extensions.
pub(super) fn parse<'a>(label: &str, json: &[u8], binary: Option<&'a [u8]>) -> Result<Document<'a>, InputError> {
    if json.len() > MAX_JSON_BYTES {
        let what = "the size of its JSON of version 1.0 in bytes".to_owned();
        return Err(InputError::TooLarge { path: label.to_owned(), what, limit: MAX_JSON_BYTES as u64 });
    }
    let old: Value = serde_json::from_slice(json).map_err(|error| InputError::json(label, &error))?;
    if old.get("extensionsUsed").and_then(Value::as_array).is_some_and(|used| used.contains(&json!(CONVERTED[2]))) {
        return Err(InputError::unsupported(label, "glTF 1.0 with quantized attributes is not supported"));
    }
    let new = Converter::new(&old).convert();
    let root: Root = serde_json::from_value(new)
        .map_err(|error| InputError::unsupported(label, format!("glTF 1.0 that cannot be converted: {error}")))?;
    check_required(label, &root)?;
    Ok(Document { root, binary, guessed: None })
}

struct Converter<'v> {
    old: &'v Value,
    /// For each of [`LISTS`], the names of its items in the order of their numbers.
    names: Vec<(&'static str, Map<String, Value>)>,
}

impl<'v> Converter<'v> {
    fn new(old: &'v Value) -> Self {
        let names = LISTS.map(|list| {
            let members = old.get(list).and_then(Value::as_object);
            let mut names: Vec<&String> = members.iter().flat_map(|members| members.keys()).collect();
            // The container's buffer is number 0 in version 2.0.
            names.sort_by_key(|name| !BINARY.contains(&name.as_str()));
            let numbers = names.into_iter().enumerate().map(|(number, name)| (name.clone(), json!(number)));
            (list, numbers.collect())
        });
        Self { old, names: names.into() }
    }

    fn convert(&self) -> Value {
        let mut new = json!({
            "asset": {"version": "2.0", "copyright": self.old.pointer("/asset/copyright")},
            "extensions": self.old.get("extensions").filter(|value| value.is_object()).cloned().unwrap_or(json!({})),
            "scene": self.old.get("scene").map(|name| self.number("scenes", name)),
            "accessors": self.list("accessors", |_, item| self.accessor(item)),
            "bufferViews": self.list("bufferViews", |_, item| json!({
                "buffer": self.number("buffers", &item["buffer"]),
                "byteOffset": item.get("byteOffset").unwrap_or(&json!(0)),
                "byteLength": item.get("byteLength").unwrap_or(&json!(0)),
            })),
            "buffers": self.list("buffers", |name, item| match BINARY.contains(&name) {
                true => json!({}),
                false => json!({"uri": item.get("uri")}),
            }),
            "images": self.list("images", |_, item| self.image(item)),
            "materials": self.list("materials", |_, item| self.material(item)),
            "meshes": self.list("meshes", |name, item| self.mesh(name, item)),
            "samplers": self.list("samplers", |_, item| json!({"wrapS": item.get("wrapS"), "wrapT": item.get("wrapT")})),
            "scenes": self.list("scenes", |_, item| json!({"nodes": self.numbers("nodes", item.get("nodes"))})),
            "textures": self.list("textures", |_, item| json!({
                "source": item.get("source").map(|name| self.number("images", name)),
                "sampler": item.get("sampler").map(|name| self.number("samplers", name)),
            })),
        });
        if let Some(members) = new.as_object_mut() {
            members.insert("nodes".into(), self.nodes());
            members.insert("extensionsRequired".into(), self.required());
        }
        new
    }

    fn required(&self) -> Value {
        let required = self.old.get("extensionsRequired").and_then(Value::as_array).into_iter().flatten();
        required.filter(|name| name.as_str().is_some_and(|name| !CONVERTED.contains(&name))).cloned().collect()
    }

    fn list(&self, list: &'static str, convert: impl Fn(&str, &Value) -> Value) -> Value {
        let names = self.names.iter().find(|(own, _)| *own == list).map(|(_, names)| names);
        let mut items: Vec<(u64, &String)> =
            names.into_iter().flatten().map(|(name, number)| (number.as_u64().unwrap_or(0), name)).collect();
        items.sort_unstable();
        items.into_iter().map(|(_, name)| convert(name, &self.old[list][name])).collect()
    }

    /// Number of an item by its name; one that no list has if it does not exist.
    fn number(&self, list: &'static str, name: &Value) -> Value {
        let names = self.names.iter().find(|(own, _)| *own == list).map(|(_, names)| names);
        let number = name.as_str().and_then(|name| names?.get(name));
        number.cloned().unwrap_or(json!(u32::MAX))
    }

    fn numbers(&self, list: &'static str, names: Option<&Value>) -> Value {
        let names = names.and_then(Value::as_array).into_iter().flatten();
        names.map(|name| self.number(list, name)).collect()
    }

    fn accessor(&self, item: &Value) -> Value {
        json!({
            "bufferView": item.get("bufferView").map(|name| self.number("bufferViews", name)),
            "byteOffset": item.get("byteOffset").unwrap_or(&json!(0)),
            "componentType": item.get("componentType").unwrap_or(&json!(0)),
            "count": item.get("count").unwrap_or(&json!(0)),
            "type": item.get("type").unwrap_or(&json!("")),
            "version1Stride": item.get("byteStride").filter(|stride| stride.as_u64() != Some(0)),
        })
    }

    fn image(&self, item: &Value) -> Value {
        match item.pointer("/extensions/KHR_binary_glTF/bufferView") {
            Some(view) => json!({"bufferView": self.number("bufferViews", view)}),
            None => json!({"uri": item.get("uri")}),
        }
    }

    fn mesh(&self, name: &str, item: &Value) -> Value {
        let primitives = item.get("primitives").and_then(Value::as_array).into_iter().flatten().map(|primitive| {
            let attributes = primitive.get("attributes").and_then(Value::as_object).into_iter().flatten();
            let attributes: Map<String, Value> =
                attributes.map(|(semantic, name)| (semantic_of(semantic), self.number("accessors", name))).collect();
            json!({
                "attributes": attributes,
                "indices": primitive.get("indices").map(|name| self.number("accessors", name)),
                "material": primitive.get("material").map(|name| self.number("materials", name)),
                "mode": primitive.get("mode"),
            })
        });
        json!({
            "name": item.get("name").filter(|name| name.is_string()).unwrap_or(&json!(name)),
            "primitives": primitives.collect::<Value>(),
            "extras": item.get("extras"),
        })
    }

    /// Nodes. Of several meshes of a node, all but the first are put into nodes of their own.
    fn nodes(&self) -> Value {
        let Value::Array(mut nodes) = self.list("nodes", |name, item| {
            json!({
                "name": item.get("name").filter(|name| name.is_string()).unwrap_or(&json!(name)),
                "children": self.numbers("nodes", item.get("children")),
                "matrix": item.get("matrix"),
                "translation": item.get("translation"),
                "rotation": item.get("rotation"),
                "scale": item.get("scale"),
                "meshes": self.numbers("meshes", item.get("meshes")),
                "extras": item.get("extras"),
            })
        }) else {
            return json!([]);
        };
        let own_count = nodes.len();
        let mut more = Vec::new();
        for node in &mut nodes {
            let Some(members) = node.as_object_mut() else { continue };
            let Some(Value::Array(meshes)) = members.remove("meshes") else { continue };
            let mut meshes = meshes.into_iter();
            members.insert("mesh".into(), meshes.next().into());
            for mesh in meshes {
                if let Some(children) = members.get_mut("children").and_then(Value::as_array_mut) {
                    children.push(json!(own_count + more.len()));
                }
                more.push(json!({"mesh": mesh}));
            }
        }
        nodes.extend(more);
        Value::Array(nodes)
    }

    fn material(&self, item: &Value) -> Value {
        let places = ["/values", "/extensions/KHR_materials_common/values", "/instanceTechnique/values"];
        let values = places.iter().find_map(|place| item.pointer(place)?.as_object());
        let diffuse = values.and_then(|values| {
            let named = ["diffuse", "u_diffuse", "tex", "u_tex"].iter().find_map(|name| values.get(*name));
            // Other names of shaders: the first that is a texture.
            named.or_else(|| {
                values.values().find(|value| {
                    self.old
                        .pointer("/textures")
                        .is_some_and(|textures| value.as_str().is_some_and(|name| textures.get(name).is_some()))
                })
            })
        });
        let base = match diffuse {
            Some(Value::String(_)) => {
                json!({"baseColorTexture": {"index": self.number("textures", diffuse.unwrap_or(&Value::Null))}})
            }
            Some(Value::Array(colour)) => json!({"baseColorFactor": linear_colour(colour)}),
            _ => json!({}),
        };
        let is_clear = base["baseColorFactor"][3].as_f64().is_some_and(|alpha| alpha < 1.0);
        json!({"pbrMetallicRoughness": base, "alphaMode": if is_clear { "BLEND" } else { "OPAQUE" }})
    }
}

/// The name of an attribute in version 2.0.
fn semantic_of(name: &str) -> String {
    match name {
        "TEXCOORD" => "TEXCOORD_0",
        "COLOR" => "COLOR_0",
        "BATCHID" => "_BATCHID",
        name => name,
    }
    .to_owned()
}

/// Colours of version 1.0 are shown as they are: sRGB.
fn linear_colour(colour: &[Value]) -> Value {
    let component = |index: usize| colour.get(index).and_then(Value::as_f64).unwrap_or(1.0).clamp(0.0, 1.0);
    let linear = |value: f64| if value <= 0.040_45 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) };
    json!([linear(component(0)), linear(component(1)), linear(component(2)), component(3)])
}
