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
        corners = triangles[t]
        if vertex not in corners:
            continue
        k = 2 if corners[2] == vertex else corners.index(vertex)
        a, b = corners[(k + 1) % 3], corners[(k + 2) % 3]
        twin = surface.twins[3 * t + (k + 1) % 3]
        beyond = triangles[twin // 3][(twin + 2) % 3]
        if all(known < vertex and surface.is_real(known) for known in (a, b, beyond)):
            found.append(Completed(a, b, beyond, a if k == 1 or t == start else corners[1]))
            if len(found) == MAX_COMPLETED:
                break
    return found
