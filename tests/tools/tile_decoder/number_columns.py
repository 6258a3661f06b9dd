"""Row sets and columns of numbers of a block of objects (docs/formats.md, "Row sets" and "Columns of numbers")."""
from .container import BadTile

PLAIN, SEQUENCE, EARLIER, DICTIONARY = range(4)
PLANES = 4
MAX_ROWS, MAX_HISTORY, MAX_SETS = 512, 64, 253


def wrapped(number):
    """As a signed integer of 64 bits."""
    return (number + (1 << 63)) % (1 << 64) - (1 << 63)


def signed_varint(reader):
    code = reader.leb128(64)
    return code >> 1 ^ -(code & 1)


class RowSets:
    def __init__(self, rows):
        self.rows, self.known = rows, []

    def read(self, reader):
        """The rows of a set, in ascending order."""
        code = reader.one("B")
        if code == 0:
            return list(range(self.rows))
        if code > 1:
            if code - 2 >= len(self.known):
                raise BadTile("a row set that does not exist")
            return self.known[code - 2]
        bits = int.from_bytes(reader.take((self.rows + 7) // 8), "little")
        if bits >> self.rows:
            raise BadTile("a row set has a row beyond the last one")
        found = [row for row in range(self.rows) if bits >> row & 1]
        if len(self.known) < MAX_SETS:
            self.known.append(found)
        return found


class History:
    """The last columns of a block, the latest first, with a number for each row."""

    def __init__(self, rows):
        self.rows, self.columns = rows, []

    def add(self, rows, numbers):
        of_row, column, last = dict(zip(rows, numbers)), [], 0
        for row in range(self.rows):
            last = of_row.get(row, last)
            column.append(last)
        self.columns = [column, *self.columns[:MAX_HISTORY - 1]]


def read_numbers(reader, count, rows=None, history=None):
    """`count` numbers. Only with `rows` they can refer to the history."""
    header = reader.one("B")
    coding, has_planes = header & ~PLANES, header & PLANES != 0
    if coding == PLAIN:
        return read_offsets(reader, count, has_planes)
    if coding == SEQUENCE:
        return read_sequence(reader, count, has_planes)
    if coding == EARLIER:
        distance = reader.one("B")
        if rows is None or not 1 <= distance <= len(history.columns):
            raise BadTile("an earlier column that does not exist")
        differences = read_offsets(reader, count, has_planes)
        return [wrapped(history.columns[distance - 1][row] + number) for row, number in zip(rows, differences)]
    if coding == DICTIONARY:
        return read_dictionary(reader, count, has_planes)
    raise BadTile("an unknown coding of numbers")


def read_dictionary(reader, count, has_planes):
    distinct = reader.leb128(64)
    header = reader.one("B")
    if distinct > MAX_ROWS or header & ~PLANES != SEQUENCE:
        raise BadTile("too many distinct numbers, or they are no sequence")
    numbers = read_sequence(reader, distinct, header & PLANES != 0)
    places = read_offsets(reader, count, has_planes)
    if not all(0 <= place < distinct for place in places):
        raise BadTile("a distinct number that does not exist")
    return [numbers[place] for place in places]


def read_sequence(reader, count, has_planes):
    if count == 0:
        return read_offsets(reader, 0, has_planes)
    numbers = [signed_varint(reader)]
    for difference in read_offsets(reader, count - 1, has_planes):
        numbers.append(wrapped(numbers[-1] + difference))
    return numbers


def read_offsets(reader, count, has_planes):
    base, width = signed_varint(reader), reader.one("B")
    if width > (8 if has_planes else 64):
        raise BadTile("a number has more than 64 bits")
    if has_planes:
        planes = [reader.take(count) for _ in range(width)]
        offsets = [int.from_bytes(bytes(plane[k] for plane in planes), "little") for k in range(count)]
    else:
        bits = int.from_bytes(reader.take((width * count + 7) // 8), "little")
        offsets = [bits >> width * k & (1 << width) - 1 for k in range(count)]
    return [wrapped(base + offset) for offset in offsets]
