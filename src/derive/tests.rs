//! Derived fields of a small source in memory.

use super::*;
use crate::source::Hierarchy;
use crate::space::{Domain, Levels};

/// Two grids whose fields are formulas of the cell.
struct Made {
    about: About,
}

const FIELDS: [(&str, Option<&str>, Option<f64>); 4] = [
    ("Density", Some("g/cm^3"), Some(1e-24)),
    ("x-velocity", Some("cm/s"), Some(1e5)),
    ("Temperature", Some("K"), Some(1.0)),
    ("colour", None, None),
];

const GRIDS: [GridRecord; 2] = [
    GridRecord { id: 1, level: 0, lo: [0; 3], size: [64, 64, 64], locator: 0 },
    GridRecord { id: 7, level: 1, lo: [8, 16, 24], size: [5, 300, 310], locator: 0 },
];

impl Made {
    fn new() -> Self {
        let domain = Domain::new([0.0; 3], [1.0; 3], [64; 3]).unwrap();
        let fields = FIELDS.map(|(name, units, to_cgs)| SourceField {
            name: name.into(),
            units: units.map(str::to_owned),
            to_cgs,
        });
        let levels = Levels::from_factors(&[2]).unwrap();
        let fields = fields.to_vec();
        let hierarchy = Hierarchy { domain, levels, fields, density: Some(0), time: None };
        Self { about: About { format: "made", path: "made".into(), hierarchy } }
    }

    fn value(field: usize, [x, y, z]: [u32; 3]) -> f64 {
        let cell = f64::from(x) + 0.01 * f64::from(y) + 0.0001 * f64::from(z);
        (field + 1) as f64 + cell.sin()
    }
}

impl Source for Made {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        GRIDS.iter().try_for_each(|grid| visit(*grid))
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        assert!(field < FIELDS.len() && out.len() == block.len());
        assert!((0..3).all(|a| block.lo[a] + block.size[a] <= grid.size[a]));
        assert!(out.len() <= HELD_VALUES, "more is asked for at a time than is to be held");
        let [nx, ny, _] = block.size;
        for (value, i) in out.iter_mut().zip(0u32..) {
            let local = [i % nx, i / nx % ny, i / nx / ny];
            *value = Self::value(field, [0, 1, 2].map(|a| block.lo[a] + local[a]));
        }
        Ok(())
    }
}

fn refused(definitions: &[&str]) -> String {
    let definitions: Vec<String> = definitions.iter().map(|&text| text.to_owned()).collect();
    match Derived::new(&Made::new(), &definitions) {
        Ok(_) => "accepted".into(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn every_cell_of_any_block_is_computed_of_its_own_values() {
    let made = Made::new();
    let definitions = [
        "ram = density * {X-velocity}^2".to_owned(),
        "twice=ram+ram".to_owned(),
        "far=twice/ram*sqrt(Temperature)*{x-velocity}/{x-velocity}".to_owned(),
    ];
    let derived = Derived::new(&made, &definitions).unwrap();
    assert_eq!(derived.names().collect::<Vec<_>>(), ["ram", "twice", "far"]);
    assert_eq!(derived.hierarchy().fields.len(), 7);
    let blocks = [
        (0, GridBlock { lo: [0; 3], size: [64; 3] }),
        (0, GridBlock { lo: [3, 5, 7], size: [1, 2, 3] }),
        (1, GridBlock { lo: [0, 1, 2], size: [5, 299, 308] }),
    ];
    for (grid, block) in blocks {
        for field in 4..7 {
            let mut values = vec![0.0; block.len()];
            derived.read(&GRIDS[grid], field, block, &mut values).unwrap();
            for (i, &value) in values.iter().enumerate() {
                let [nx, ny, _] = block.size.map(|n| n as usize);
                let local = [i % nx, i / nx % ny, i / nx / ny];
                let cell = std::array::from_fn(|a| block.lo[a] + local[a] as u32);
                let own = |field| Made::value(field, cell);
                let ram = own(0) * (own(1) * own(1));
                let expected = match field {
                    4 => ram,
                    5 => ram + ram,
                    6 => (ram + ram) / ram * own(2).sqrt() * own(1) / own(1),
                    _ => own(field),
                };
                assert_eq!(value, expected, "field {field}, cell {cell:?}");
            }
        }
    }
}

#[test]
fn units_go_from_field_to_field() {
    let made = Made::new();
    let definitions = [
        "ram = density * {x-velocity}^2".to_owned(),
        "speed = sqrt(ram / density)".to_owned(),
        "mach = speed / {x-velocity}".to_owned(),
        "odd = colour * density".to_owned(),
    ];
    let derived = Derived::new(&made, &definitions).unwrap();
    let field = |number: usize| &derived.hierarchy().fields[number];
    assert_eq!(field(4).units.as_deref(), Some("g/(cm*s^2)"));
    assert_eq!(field(5).units.as_deref(), Some("cm/s"));
    assert!((field(5).to_cgs.unwrap() / 1e5 - 1.0).abs() < 1e-14);
    assert_eq!(field(6).units.as_deref(), Some("dimensionless"));
    assert_eq!((&field(7).units, field(7).to_cgs), (&None, None));
}

#[test]
fn what_cannot_be_derived_is_refused_with_what_to_do() {
    for (definition, expected) in [
        ("density*2", "write one as NAME=EXPRESSION"),
        ("=density", "its name must have"),
        ("a\nb=density", "its name must have"),
        ("{a}=density", "no braces"),
        ("DENSITY=colour", "a field `DENSITY` already"),
        ("a=density*(", "it ends where"),
        ("a=densty*2", "no field `densty`: there are Density, {x-velocity}, Temperature, colour"),
        ("a=x-velocity", "no field `x` (is {x-velocity} meant?): there are "),
        ("a=b+1", "no field `b`"),
        ("a=a+1", "no field `a`"),
        ("a=2*3", "names no field"),
        ("a=density+temperature", "it adds or compares g/cm^3 and K"),
        ("a=sin(density)", "no function `sin`: there are"),
    ] {
        let message = refused(&[definition]);
        assert!(message.contains(expected), "{definition}: {message}");
        assert!(message.starts_with("--derive `") && !message.contains('\n'), "{message}");
    }
    assert!(refused(&["a=density", "A=colour"]).contains("there is a field `A` already"));
    let many: Vec<String> = (0..=MOST_FIELDS).map(|n| format!("a{n}=density")).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    assert!(refused(&many).contains("64 derived fields already"));
}

#[test]
fn only_more_than_a_name_is_an_expression() {
    for (text, expected) in [
        ("density * 2", true),
        ("x-velocity", true),
        ("Density", false),
        ("{a b}", false),
        ("a b", false),
    ] {
        assert_eq!(is_expression(text), expected, "{text}");
    }
}
