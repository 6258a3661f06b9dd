"""Lists of texts of a block of objects (docs/formats.md, "Lists of texts")."""
import re
from .container import BadTile
from .number_columns import read_numbers

FRONT, PATTERNS, IDENTIFIERS = range(3)
MAX_TEXT_BYTES, MAX_BYTES = 4096, 16 << 20
MAX_PATTERNS, MAX_RUNS = 64, 16
RUN = re.compile("[0-9]{1,18}")


class TextReader:
    """The lists of one payload, which share a limit of bytes."""

    def __init__(self, reader, history):
        self.reader, self.history, self.bytes_left = reader, history, MAX_BYTES
        self.identifiers = None

    def take(self, count):
        self.bytes_left -= count
        if count > MAX_TEXT_BYTES or self.bytes_left < 0:
            raise BadTile("a text or the texts of a block are too long")

    def read(self, count, rows=None):
        """`count` texts; those of rows may refer to the history and to identifiers, and enter the history."""
        coding = self.reader.one("B")
        if coding == FRONT:
            return self.read_front(count)
        if coding == PATTERNS:
            return self.read_patterns(count, rows)
        if coding == IDENTIFIERS and rows is not None and self.identifiers is not None:
            texts = [self.identifiers[row] for row in rows]
            for text in texts:
                self.take(len(text.encode()))
            return texts
        raise BadTile("an unknown coding of texts, or identifiers that do not exist")

    def read_front(self, count):
        shared = read_numbers(self.reader, count)
        lengths = read_numbers(self.reader, count)
        texts, text = [], b""
        for start, length in zip(shared, lengths):
            if not 0 <= start <= len(text) or length < 0:
                raise BadTile("a length of a text is out of range")
            self.take(start + length)
            text = text[:start] + self.reader.take(length)
            texts.append(as_text(text))
        return texts

    def read_patterns(self, count, rows):
        pattern_count = self.reader.leb128(64)
        if pattern_count > MAX_PATTERNS:
            raise BadTile("too many patterns")
        patterns = self.read_front(pattern_count)
        runs = [len(RUN.findall(pattern)) for pattern in patterns]
        if max(runs, default=0) > MAX_RUNS:
            raise BadTile("too many runs of digits")
        chosen = read_numbers(self.reader, count)
        if not all(0 <= place < pattern_count for place in chosen):
            raise BadTile("a pattern that does not exist")
        columns = []
        for run in range(max(runs, default=0)):
            texts = [k for k in range(count) if runs[chosen[k]] > run]
            own = None if rows is None else [rows[k] for k in texts]
            columns.append((own, read_numbers(self.reader, len(texts), own, self.history)))
        out = self.fill([patterns[place] for place in chosen], columns)
        if rows is not None:
            for own, numbers in columns:
                self.history.add(own, numbers)
        return out

    def fill(self, patterns, columns):
        numbers, out = [iter(numbers) for _, numbers in columns], []
        for pattern in patterns:
            self.take(len(pattern.encode()))
            own = iter(numbers)
            out.append(RUN.sub(lambda run: digits(next(next(own)), len(run[0])), pattern))
        return out


def digits(number, count):
    text = str(number).zfill(count)
    if number < 0 or len(text) != count:
        raise BadTile("a number does not fit into its text")
    return text


def as_text(data):
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise BadTile("a text is not UTF-8") from error
