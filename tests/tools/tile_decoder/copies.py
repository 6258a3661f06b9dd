"""Vertices of coded meshes that are copies of others (docs/formats.md, "Copies")."""
from .container import BadTile
from .symbol_coder import SymbolModel, even_model

NEAR, FAR = 7, 15


def read_copies(coder, surface):
    """For each vertex the earlier one that it is a copy of, or itself."""
    vertices = len(surface.degree)
    originals = list(range(vertices))
    if not coder.symbol(SymbolModel([3, 1])):
        return originals
    models, difference = [SymbolModel([9, 1]) for _ in range(4)], even_model(16)
    last_two = original = 0
    for vertex in filter(surface.is_real, range(vertices)):
        is_copy = coder.symbol(models[last_two])
        last_two = last_two << 1 & 3 | is_copy
        if is_copy:
            symbol = coder.symbol(difference)
            original = original + symbol - NEAR if symbol < FAR else read_vertex_below(coder, vertex)
            if not 0 <= original < vertex or not surface.is_real(original):
                raise BadTile("a vertex copies one that does not exist")
            originals[vertex] = original
    return originals


def read_vertex_below(coder, vertex):
    """Raw bits, as many as `vertex` has digits: first those above the lowest 15."""
    bits = vertex.bit_length()
    high = coder.raw(max(bits - 15, 0))
    return high << 15 | coder.raw(min(bits, 15))
