"""Connectivity of coded meshes (docs/formats.md, "Connectivity").

Half-edge `3 t + k` goes from corner k of triangle t to the next corner.
"""
from .container import BadTile
from .symbol_coder import SymbolModel, even_model

JOIN, DUMMY, MORE = 0, 1, 15
TYPICAL = [30, 10, 5, 30, 120, 300, 400, 300, 100, 40, 20, 10, 6, 4, 3, 3]
BUCKETS = 64
FORWARDS, BACKWARDS, BY_NUMBER = 0, 1, 2
MAX_STEPS = 1024


def next_half_edge(half_edge):
    return half_edge - 2 if half_edge % 3 == 2 else half_edge + 1


def previous_half_edge(half_edge):
    return half_edge + 2 if half_edge % 3 == 0 else half_edge - 1


class Surface:
    """The triangles in the order of the traversal, which numbers the vertices, too."""

    def __init__(self):
        self.triangles, self.first_triangle, self.degree, self.dummies = [], [], [], set()
        # By half-edge.
        self.twins = []
        # By triangle.
        self.beyond = []

    def is_real(self, vertex):
        return vertex not in self.dummies

    def link(self, a, b):
        self.twins[a], self.twins[b] = b, a


class Node:
    """A vertex in an active list. `next` is None once it is removed."""

    __slots__ = ("vertex", "free", "next", "previous", "edge", "opposite")

    def __init__(self, vertex, free, edge, opposite):
        self.vertex, self.free, self.edge, self.opposite = vertex, free, edge, opposite
        self.next = self.previous = None


def chain(a, b):
    a.next, b.previous = b, a


def read_connectivity(coder, max_triangles):
    return ConnectivityReader(coder, max_triangles).read()


class ConnectivityReader:
    def __init__(self, coder, max_triangles):
        self.coder, self.max_triangles, self.surface = coder, max_triangles, Surface()
        self.nodes, self.full = [], []
        self.queues, self.lowest = [[] for _ in range(BUCKETS)], BUCKETS
        self.has_piece = SymbolModel([1, 4])
        self.first_degree = SymbolModel([0] + TYPICAL[1:])
        self.by_edge, self.by_side = ([SymbolModel(TYPICAL) for _ in range(count)] for count in (49, 63))
        self.more, self.steps, self.share = even_model(32), even_model(32), even_model(32)
        self.direction = even_model(4)

    def read(self):
        while self.coder.symbol(self.has_piece):
            self.start_piece()
            while (focus := self.pop_focus()) is not None:
                while focus.next is not None:
                    self.step(focus)
        return self.surface

    def start_piece(self):
        edge = len(self.surface.twins)
        corners = [self.add_vertex(self.coder.symbol(self.first_degree)) for _ in range(3)]
        a, b, c = (
            self.add_node(corner, edge + (k + 2) % 3, corners[(k + 1) % 3]) for k, corner in enumerate(corners)
        )
        self.add_triangle(corners, None)
        chain(a, c)
        chain(c, b)
        chain(b, a)
        self.changed(a, b, c)
        self.close_full_nodes()

    def step(self, focus):
        """Adds the triangle beyond the edge from the node before the focus to the focus."""
        before = focus.previous
        symbol = self.coder.pair(*self.degree_models(before, focus))
        if symbol == JOIN:
            self.join(focus)
            return
        vertex = self.add_vertex(symbol)
        edge = self.add_triangle([before.vertex, focus.vertex, vertex], before.opposite)
        self.surface.link(edge, before.edge)
        node = self.add_node(vertex, edge + 1, before.vertex)
        chain(before, node)
        chain(node, focus)
        before.edge, before.opposite = edge + 2, focus.vertex
        before.free -= 1
        focus.free -= 1
        self.changed(node, before)
        if focus.free == 0:
            self.full.append(focus)
        self.close_full_nodes()

    def join(self, focus):
        """Adds a triangle whose third vertex is in a list already."""
        before = focus.previous
        met = self.read_met_node(focus, before)
        if met.next is None or met.free < 2 or met.vertex in (before.vertex, focus.vertex):
            raise BadTile("a mesh joins itself where it cannot")
        free = self.coder.number(self.share) if met.free > 2 else 0
        if free > met.free - 2:
            raise BadTile("a join has more free edges than its vertex")
        beyond = before.opposite if self.is_latest(met.vertex) else None
        edge = self.add_triangle([before.vertex, focus.vertex, met.vertex], beyond)
        self.surface.link(edge, before.edge)
        node = Node(met.vertex, free, met.edge, met.opposite)
        self.nodes.append(node)
        chain(node, met.next)
        chain(before, node)
        chain(met, focus)
        met.edge, met.opposite, met.free = edge + 1, before.vertex, met.free - 2 - free
        before.edge, before.opposite = edge + 2, focus.vertex
        before.free -= 1
        focus.free -= 1
        self.changed(node, met, before, focus)
        self.close_full_nodes()

    def read_met_node(self, focus, before):
        direction, steps = self.coder.symbol(self.direction), self.coder.number(self.steps)
        if direction == BY_NUMBER and steps < len(self.nodes):
            return self.nodes[steps]
        if direction > BACKWARDS or steps >= MAX_STEPS:
            raise BadTile("a join names no node")
        node = focus.next if direction == FORWARDS else before.previous
        for _ in range(steps):
            node = node.next if direction == FORWARDS else node.previous
        return node

    def close_full_nodes(self):
        """Adds the last triangles of vertices without free edges, the latest first."""
        while self.full:
            node = self.full.pop()
            if node.next is None:
                continue
            before, after = node.previous, node.next
            beyond = None
            if self.is_latest(after.vertex):
                beyond = before.opposite
            elif self.is_latest(before.vertex):
                beyond = node.opposite
            edge = self.add_triangle([before.vertex, node.vertex, after.vertex], beyond)
            self.surface.link(edge, before.edge)
            self.surface.link(edge + 1, node.edge)
            node.next = None
            if before.free == after.free == 0 and after.next is before:
                self.surface.link(edge + 2, after.edge)
                before.next = after.next = None
                continue
            if before.free == 0 or after.free == 0 or before is after:
                raise BadTile("a mesh closes where it cannot")
            chain(before, after)
            before.edge, before.opposite = edge + 2, node.vertex
            before.free -= 1
            after.free -= 1
            self.changed(before, after)

    def changed(self, *nodes):
        """Notes that the numbers of free edges of these nodes are new."""
        for node in nodes:
            if node.free == 0:
                self.full.append(node)
            else:
                bucket = min(node.free, BUCKETS - 1)
                self.queues[bucket].append(node)
                self.lowest = min(self.lowest, bucket)

    def pop_focus(self):
        """The node with the fewest free edges, the latest of equals; None if all lists are empty."""
        while self.lowest < BUCKETS:
            queue = self.queues[self.lowest]
            while queue:
                node = queue.pop()
                if node.next is not None and min(node.free, BUCKETS - 1) == self.lowest:
                    return node
            self.lowest += 1
        return None

    def degree_models(self, before, focus):
        degrees = (self.surface.degree[node.vertex] for node in (before, focus, focus.next))
        first, second, third = (min(max(degree, 3), 9) - 3 for degree in degrees)
        free = [min(node.free, 3) - 1 for node in (before, focus)]
        return self.by_edge[first * 7 + second], self.by_side[third * 9 + free[0] * 3 + free[1]]

    def add_vertex(self, symbol):
        """Adds a vertex of the degree that a symbol stands for."""
        surface, vertex, degree = self.surface, len(self.surface.degree), symbol
        if symbol in (DUMMY, MORE):
            degree = self.coder.number(self.more) + (2 if symbol == DUMMY else MORE)
        if degree < 2 or degree > self.max_triangles:
            raise BadTile("a vertex has an impossible degree")
        if symbol == DUMMY:
            surface.dummies.add(vertex)
        surface.degree.append(degree)
        surface.first_triangle.append(len(surface.triangles))
        return vertex

    def is_latest(self, vertex):
        return vertex == len(self.surface.degree) - 1

    def add_node(self, vertex, edge, opposite):
        """Adds the node of a new vertex."""
        self.nodes.append(Node(vertex, self.surface.degree[vertex] - 2, edge, opposite))
        return self.nodes[-1]

    def add_triangle(self, corners, beyond):
        """Adds a triangle and returns its first half-edge. `beyond` is the vertex beyond the edge opposite to the latest
        vertex, if that is a corner and the triangle there was added before."""
        if len(self.surface.triangles) >= self.max_triangles:
            raise BadTile("a mesh has more triangles than it says")
        self.surface.triangles.append(corners)
        self.surface.beyond.append(beyond)
        self.surface.twins += [None] * 3
        return len(self.surface.twins) - 3
