"""Object tiles: schema and blocks of objects (docs/formats.md, "Object tiles")."""
import json, math, re, struct, zlib
from .container import BadTile, Bytes, unpack_zstd
from .number_columns import History, RowSets, read_numbers, wrapped
from .single import single
from .text_lists import TextReader

CONTENT = 1
MAX_CONTENT_BYTES, MAX_PAYLOAD_BYTES = 4 << 20, 16 << 20
BLOCK_OBJECTS, MAX_BLOCK, BLOCK_LEVEL = 512, (1 << 23) - 1, 12
MAX_ATTRIBUTES, MAX_NAME_BYTES, MAX_TOP, MAX_DISTINCT, MAX_TEXT_BYTES = 4096, 256, 20, 1000, 4096
KINDS = ["building", "building-part", "bridge", "tunnel", "road", "rail", "water", "vegetation", "land-use", "furniture",
         "relief", "generic"]
TYPES = ["text", "integer", "float", "bool", "date"]
SCHEMA_FIELDS = {"objects", "attributes", "searchable", "labels"}
FIELD_NAMES = ["id", "identifier", "kind", "height"]
LABEL_FIELDS = {"title": str, "titles": dict, "order": int, "hidden": bool}
MAX_TITLE_BYTES, MAX_LANGUAGES = 256, 64
ATTRIBUTE_FIELDS = {"name", "type", "unit", "count", "min", "max", "distinct", "top"}


def read_object_tile(tile_id, sections, schema=None):
    """A schema, or a block, whose types are compared with those of `schema` if that is given."""
    content = sections.get(CONTENT, b"")
    if not 1 <= len(content) <= MAX_CONTENT_BYTES:
        raise BadTile("an object tile without content, or too much of it")
    if tile_id == (0, 0, 0):
        return {"kind": "schema", "schema": read_schema(content)}
    block = block_of_place(tile_id)
    return {"kind": "objects", "block": block, "objects": read_block(content, block, schema)}


def block_of_place(tile_id):
    if tile_id is None or tile_id[0] != BLOCK_LEVEL:
        raise BadTile("an object tile at a place that is none of a block")
    return sum((tile_id[1] >> k & 1) << 2 * k | (tile_id[2] >> k & 1) << 2 * k + 1 for k in range(BLOCK_LEVEL))


# "The schema"


def read_schema(content):
    try:
        schema = json.loads(content.decode())
        check_schema(schema)
    except (ValueError, AttributeError, TypeError) as error:
        raise BadTile("a schema is not JSON of the right types") from error
    return schema


def check_schema(schema):
    attributes = schema.get("attributes", [])
    if not {"objects", "attributes"} <= schema.keys() <= SCHEMA_FIELDS or len(attributes) > MAX_ATTRIBUTES:
        raise BadTile("a schema has other fields or too many attributes")
    for attribute in attributes:
        check_attribute(attribute)
    if len({attribute["name"] for attribute in attributes}) < len(attributes):
        raise BadTile("two attributes have the same name")
    labels = schema.get("labels", {})
    if len(labels) > MAX_ATTRIBUTES + len(FIELD_NAMES):
        raise BadTile("a schema has too many labels")
    for label in labels.values():
        check_label(label)


def check_label(label):
    if not all(type(value) is LABEL_FIELDS.get(field) for field, value in label.items()):
        raise BadTile("a label has other fields")
    titles = label.get("titles", {})
    texts = [label.get("title", ""), *titles.values()]
    is_language = re.compile(r"[a-z0-9]{2,3}(-[a-z0-9]+)*").fullmatch
    if len(titles) > MAX_LANGUAGES or not all(map(is_language, titles)) or not 0 <= label.get("order", 0) < 1 << 32:
        raise BadTile("a label has a language or a place that is none")
    if any(len(text.encode()) > MAX_TITLE_BYTES for text in texts):
        raise BadTile("a title is too long")


def check_attribute(attribute):
    if not {"name", "type", "count"} <= attribute.keys() <= ATTRIBUTE_FIELDS or attribute["type"] not in TYPES:
        raise BadTile("an attribute has other fields or an unknown type")
    names = attribute["name"], attribute.get("unit", "")
    ends = [attribute[end] for end in ("min", "max") if end in attribute]
    top = attribute.get("top", [])
    if not names[0] or any(len(name.encode()) > MAX_NAME_BYTES for name in names):
        raise BadTile("an attribute's name or unit is empty or too long")
    if not all(map(math.isfinite, ends)) or ends != sorted(ends) or attribute.get("distinct", 0) > MAX_DISTINCT:
        raise BadTile("an attribute's range or number of values is out of range")
    if len(top) > MAX_TOP or any(len(text.encode()) > MAX_TEXT_BYTES for text, _ in top):
        raise BadTile("an attribute has too many or too long frequent values")


# "Blocks of objects"


def read_block(content, block, schema=None):
    """The objects of a block, each with its number."""
    reader = Bytes(content)
    magic, version, crc, number, payload_bytes = struct.unpack("<4sHIII", reader.take(18))
    if magic != b"INSO" or version != 1 or zlib.crc32(content[10:]) != crc:
        raise BadTile("not a block of objects of version 1, or its checksum is wrong")
    if number != block or block > MAX_BLOCK or payload_bytes > MAX_PAYLOAD_BYTES:
        raise BadTile("a block has another number, or its payload is too large")
    payload = unpack_zstd(reader.rest())
    if len(payload) != payload_bytes:
        raise BadTile("a block's payload has another length")
    return BlockReader(Bytes(payload), BLOCK_OBJECTS * block).read(schema and schema["attributes"])


class BlockReader:
    def __init__(self, reader, first):
        self.reader = reader
        slots = reader.leb128(64)
        if slots > BLOCK_OBJECTS:
            raise BadTile("a block has too many objects")
        self.objects = [{"number": first + slot} for slot in RowSets(slots).read(reader)]
        self.row_sets, self.history = RowSets(len(self.objects)), History(len(self.objects))
        self.texts = TextReader(reader, self.history)

    def read(self, attributes):
        self.read_kinds()
        self.texts.identifiers = self.read_identifiers()
        self.read_parents()
        self.read_bounds()
        self.read_attributes(attributes)
        self.reader.finish()
        return self.objects

    def read_kinds(self):
        for item, kind in zip(self.objects, read_numbers(self.reader, len(self.objects))):
            if not 0 <= kind < len(KINDS):
                raise BadTile("an unknown kind of object")
            item["kind"] = KINDS[kind]

    def read_identifiers(self):
        identifiers = self.texts.read(len(self.objects), list(range(len(self.objects))))
        for item, identifier in zip(self.objects, identifiers):
            item["identifier"] = identifier
        return identifiers

    def read_parents(self):
        rows = self.row_sets.read(self.reader)
        for row, difference in zip(rows, read_numbers(self.reader, len(rows))):
            parent = self.objects[row]["number"] + difference
            if not 0 <= parent < 1 << 32:
                raise BadTile("a parent's number is out of range")
            self.objects[row]["parent"] = parent

    def read_bounds(self):
        rows = self.row_sets.read(self.reader)
        ends = [self.read_axis(rows) for _ in range(3)]
        for row, *axes in zip(rows, *ends):
            self.objects[row]["bounds_dm"] = [list(end) for end in zip(*axes)]

    def read_axis(self, rows):
        lower, extent = self.of_rows(rows), self.of_rows(rows)
        ends = [(low, low + size) for low, size in zip(lower, extent)]
        if not all(-1 << 31 <= low <= high < 1 << 31 for low, high in ends):
            raise BadTile("an object's bounds are inverted or too large")
        return ends

    def of_rows(self, rows):
        """Numbers that enter the history."""
        numbers = read_numbers(self.reader, len(rows), rows, self.history)
        self.history.add(rows, numbers)
        return numbers

    def read_attributes(self, attributes):
        count, place = self.reader.leb128(64), -1
        limit = MAX_ATTRIBUTES if attributes is None else len(attributes)
        if count > limit:
            raise BadTile("a block has too many columns")
        for item in self.objects:
            item["attributes"] = {}
        for _ in range(count):
            place, type_number = place + 1 + self.reader.leb128(64), self.reader.one("B")
            if place >= limit or type_number >= len(TYPES):
                raise BadTile("an attribute or a type that does not exist")
            if attributes is not None and attributes[place]["type"] != TYPES[type_number]:
                raise BadTile("an attribute has another type than in the schema")
            rows = self.row_sets.read(self.reader)
            for row, value in zip(rows, self.read_values(TYPES[type_number], rows)):
                self.objects[row]["attributes"][place] = value

    def read_values(self, value_type, rows):
        if value_type == "text":
            return self.read_texts(rows)
        if value_type == "float":
            return self.read_floats(rows)
        numbers = self.of_rows(rows)
        low, high = {"integer": (-1 << 63, 1 << 63), "bool": (0, 2), "date": (-1 << 31, 1 << 31)}[value_type]
        if not all(low <= number < high for number in numbers):
            raise BadTile("a number is none of its type")
        return list(map(bool, numbers)) if value_type == "bool" else numbers

    def read_texts(self, rows):
        coding = self.reader.one("B")
        if coding == 0:
            return self.texts.read(len(rows), rows)
        count = self.reader.leb128(64)
        if coding != 1 or count > len(rows):
            raise BadTile("an unknown coding of texts, or too many distinct ones")
        texts, used, out = self.texts.read(count), 0, []
        for number in self.of_rows(rows):
            used += number == 0
            place = used - 1 if number == 0 else number - 1
            if not 0 <= place < used <= count:
                raise BadTile("a distinct text that does not exist, or does not come before")
            out.append(texts[place])
        if used != count:
            raise BadTile("a distinct text that is not used")
        return out

    def read_floats(self, rows):
        kind = self.reader.one("B")
        numbers = read_numbers(self.reader, len(rows), rows, self.history)
        corrections = read_numbers(self.reader, len(rows)) if kind & 32 else [0] * len(rows)
        self.history.add(rows, numbers)
        values = [from_order(wrapped(order(float_of(kind & ~32, number)) + c)) for number, c in zip(numbers, corrections)]
        if not all(map(math.isfinite, values)):
            raise BadTile("a float is not finite")
        return values


def float_of(kind, number):
    if kind <= 6:
        value = float(number) / 10.0 ** kind
    elif 8 <= kind <= 14:
        value = float(single(float(number) / 10.0 ** (kind - 8)))
    elif kind == 16 and -1 << 31 <= number < 1 << 31:
        value = from_order(number, "<i", "<f")
    elif kind == 17:
        value = from_order(number)
    else:
        raise BadTile("an unknown kind of floats")
    if not math.isfinite(value):
        raise BadTile("a float is not finite")
    return value


def order(value):
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return bits if bits >= 0 else bits ^ (1 << 63) - 1


def from_order(number, integer="<q", real="<d"):
    highest = 1 << 8 * struct.calcsize(integer) - 1
    bits = number if number >= 0 else number ^ highest - 1
    return struct.unpack(real, struct.pack(integer, bits))[0]
