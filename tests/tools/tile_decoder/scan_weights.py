"""Weights of scan positions (docs/formats.md, "Weights")."""
from .container import BadTile
from .single import single
from .symbol_coder import even_model

OF_ONE, OF_ONE_PAIR, DEGREES = 9, 12, 3
FIRST_OF_MANY = OF_ONE + 9 * OF_ONE_PAIR
CLASSES = FIRST_OF_MANY + DEGREES
BY_DEGREES = 2
LARGEST = 512


def typical(vertex_class):
    """The weights in front of a class that starts a group; None for others."""
    if vertex_class == 0:
        return [128, -128, 0, 0, 0]
    if vertex_class == FIRST_OF_MANY:
        return [85, -128, 0, 0, 0]
    if OF_ONE <= vertex_class < FIRST_OF_MANY and (vertex_class - OF_ONE) % OF_ONE_PAIR == 0:
        return [64, -64, 64, -64, 0]
    return None


def used(vertex_class, classes):
    count = 4 if OF_ONE <= vertex_class < FIRST_OF_MANY else 2
    return [*range(count), 4] if classes == BY_DEGREES and vertex_class < FIRST_OF_MANY else range(count)


def read_weights(coder, classes):
    """For each class, five weights."""
    has_own, models = even_model(2), [even_model(32), even_model(32)]
    found, weights = [], None
    for vertex_class in range(CLASSES):
        weights = list(typical(vertex_class) or weights)
        if coder.symbol(has_own):
            for k in used(vertex_class, classes):
                number = coder.number(models[k % 2])
                weights[k] += number >> 1 ^ -(number & 1)
                if abs(weights[k]) > LARGEST:
                    raise BadTile("a mesh's weights are too large")
        found.append([single(weight / 128) for weight in weights])
    return found
