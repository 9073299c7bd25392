//! Roles of unnamed columns, by their values.

use super::Role;
use super::sniff::Row;
use crate::cloud::text;

/// The kind of a column's fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    Numbers,
    /// Numbers and words.
    Mixed,
    Text,
    Empty,
}

impl Kind {
    pub fn of(
        rows: &[Row],
        place: usize,
        width: usize,
        is_number: &impl Fn(&Vec<u8>) -> bool,
    ) -> Kind {
        let fields = || {
            rows.iter()
                .filter(|row| row.fields.len() >= width)
                .map(|row| &row.fields[place])
                .filter(|field| !field.is_empty())
        };
        let (all, numbers) = (fields().count(), fields().filter(|field| is_number(field)).count());
        match (all, numbers) {
            (0, _) => Kind::Empty,
            (_, 0) => Kind::Text,
            _ if numbers * 2 >= all => Kind::Numbers,
            _ => Kind::Mixed,
        }
    }
}

/// Columns without names.
pub struct Values<'r, 'a> {
    pub rows: &'r [Row<'a>],
    pub kinds: &'r [Kind],
    pub decimal_comma: bool,
}

impl Values<'_, '_> {
    /// Assigns roles. x, y and z are the first numeric columns without another role. The number and
    /// values of those after them decide: one is intensity, three are colours or normals, four are
    /// both, six are colours and normals.
    pub fn roles(&self, mut roles: Vec<Role>) -> Option<Vec<Role>> {
        let is_named = roles.iter().any(|&role| role != Role::Other);
        roles
            .iter_mut()
            .filter(|role| matches!(role, Role::Position(_)))
            .for_each(|role| *role = Role::Other);
        let free: Vec<usize> = (0..roles.len())
            .filter(|&place| roles[place] == Role::Other && self.kinds[place] == Kind::Numbers)
            .collect();
        let [x, y, z, rest @ ..] = free.as_slice() else { return None };
        [x, y, z]
            .into_iter()
            .enumerate()
            .for_each(|(axis, &place)| roles[place] = Role::Position(axis));
        // Columns with unknown names are not guessed.
        if is_named {
            return Some(roles);
        }
        let mut assign = |places: &[usize], role: fn(usize) -> Role| {
            places.iter().enumerate().for_each(|(i, &place)| roles[place] = role(i))
        };
        let intensity: fn(usize) -> Role = |_| Role::Intensity;
        match rest {
            [first] | [first, _] => assign(&[*first], intensity),
            [triple @ .., last]
                if triple.len() == 3 && self.are_bytes(triple) && !self.are_bytes(&[*last]) =>
            {
                assign(triple, Role::Color);
                assign(&[*last], intensity);
            }
            [first, triple @ ..] if (3..5).contains(&triple.len()) => {
                assign(&[*first], intensity);
                assign(&triple[..3], self.triple(&triple[..3]));
            }
            [..] if rest.len() >= 3 => {
                let kind = self.triple(&rest[..3]);
                assign(&rest[..3], kind);
                if let Some(second) =
                    rest.get(3..6).filter(|second| self.triple(second)(0) != kind(0))
                {
                    assign(second, self.triple(second));
                }
            }
            _ => {}
        }
        Some(roles)
    }

    fn values(&self, places: &[usize]) -> impl Iterator<Item = f64> {
        let fields = self
            .rows
            .iter()
            .flat_map(move |row| places.iter().filter_map(|&place| row.fields.get(place)));
        fields.filter_map(|field| text::number_with(field, self.decimal_comma))
    }

    fn are_bytes(&self, places: &[usize]) -> bool {
        self.values(places).all(|v| v.fract() == 0.0 && (0.0..=255.0).contains(&v))
    }

    /// Tells normals from colours: normals are within -1 and 1, and some below 0.
    fn triple(&self, places: &[usize]) -> fn(usize) -> Role {
        let are_normals =
            self.values(places).all(|v| v.abs() <= 1.0) && self.values(places).any(|v| v < 0.0);
        if are_normals { Role::Normal } else { Role::Color }
    }
}
