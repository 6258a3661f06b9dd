"""Triangles that a vertex completes (docs/formats.md, "Completed triangles")."""
from collections import namedtuple

MAX_COMPLETED = 6


class Completed(namedtuple("Completed", "a b beyond full")):
    @property
    def other(self):
        """The one of `a` and `b` that is not `full`."""
        return self.b if self.full == self.a else self.a


def completed_triangles(surface, vertex):
    triangles, firsts = surface.triangles, surface.first_triangle
    start = firsts[vertex]
    end = firsts[vertex + 1] if vertex + 1 < len(firsts) else len(triangles)
    found = []
    for t in range(start, end):
        corners, beyond = triangles[t], surface.beyond[t]
        a, b = corners[:2] if corners[2] == vertex else corners[1:]
        if beyond is not None and beyond < vertex and all(map(surface.is_real, (a, b, beyond))):
            found.append(Completed(a, b, beyond, a if t == start else corners[1]))
            if len(found) == MAX_COMPLETED:
                break
    return found
