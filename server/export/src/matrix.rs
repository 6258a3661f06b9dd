//! Affine maps of space as glTF and 3D Tiles write them.

/// An affine map. Columns of its linear part, and where it moves the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Matrix {
    pub(crate) axes: [[f64; 3]; 3],
    pub(crate) origin: [f64; 3],
}

impl Matrix {
    pub(crate) const IDENTITY: Self =
        Self { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], origin: [0.0; 3] };
    /// From z up to y up: the map of 3D Tiles 1.1, section "glTF transforms", backwards.
    pub(crate) const Y_UP: Self = Self { axes: [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], origin: [0.0; 3] };

    pub(crate) fn scale([x, y, z]: [f64; 3]) -> Self {
        Self { axes: [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]], origin: [0.0; 3] }
    }

    pub(crate) fn translation(origin: [f64; 3]) -> Self {
        Self { origin, ..Self::IDENTITY }
    }

    /// Maps a direction.
    pub(crate) fn turn(&self, v: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| (0..3).map(|axis| self.axes[axis][k] * v[axis]).sum())
    }

    pub(crate) fn map(&self, p: [f64; 3]) -> [f64; 3] {
        add(self.turn(p), self.origin)
    }

    /// This map and then another one.
    pub(crate) fn then(&self, next: &Self) -> Self {
        Self { axes: self.axes.map(|axis| next.turn(axis)), origin: next.map(self.origin) }
    }

    /// The inverse of a map whose axes are perpendicular and of length 1.
    pub(crate) fn inverse_rigid(&self) -> Self {
        let axes = [0, 1, 2].map(|k| self.axes.map(|axis| axis[k]));
        let inverse = Self { axes, origin: [0.0; 3] };
        Self { axes, origin: inverse.turn(self.origin).map(|v| -v) }
    }

    /// Sixteen numbers, column by column.
    pub(crate) fn to_array(self) -> [f64; 16] {
        let [x, y, z] = self.axes;
        let o = self.origin;
        [x[0], x[1], x[2], 0.0, y[0], y[1], y[2], 0.0, z[0], z[1], z[2], 0.0, o[0], o[1], o[2], 1.0].map(|v| v + 0.0)
    }
}

pub(crate) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] + b[k])
}

pub(crate) fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

pub(crate) fn times(a: [f64; 3], factor: f64) -> [f64; 3] {
    a.map(|v| v * factor)
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_combined_in_order_and_inverted() {
        let turned = Matrix::Y_UP.then(&Matrix::translation([5.0, 6.0, 7.0]));
        assert_eq!(turned.map([1.0, 2.0, 3.0]), [6.0, 9.0, 5.0]);
        assert_eq!(turned.inverse_rigid().map([6.0, 9.0, 5.0]), [1.0, 2.0, 3.0]);
        let scaled = Matrix::scale([2.0, 2.0, 4.0]).then(&turned);
        assert_eq!(scaled.map([0.5, 1.0, 0.75]), [6.0, 9.0, 5.0]);
        assert_eq!(scaled.to_array()[..4], [2.0, 0.0, 0.0, 0.0]);
    }
}
