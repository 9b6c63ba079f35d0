//! What a simulation output says of itself, without reading its fields.

use std::path::Path;

use serde_json::{Value, json};

use crate::Result;
use crate::source::{Source, SourceField};

/// Grids and cells of one level.
#[derive(Clone, Copy, Default)]
struct Count {
    grids: u64,
    cells: u64,
}

/// The facts that `info` prints, but for those that only all cells together tell.
pub(super) fn facts(source: &dyn Source, path: &Path) -> Result<Value> {
    let hierarchy = source.hierarchy();
    let mut counts = vec![Count::default(); hierarchy.levels.count()];
    source.for_each_grid(&mut |grid| {
        if let Some(count) = counts.get_mut(grid.level as usize) {
            count.grids += 1;
            let cells = grid.size.iter().fold(1u64, |n, &size| n.saturating_mul(size.into()));
            count.cells = count.cells.saturating_add(cells);
        }
        Ok(())
    })?;
    let octree = |level: usize| hierarchy.levels.octree(level).unwrap_or(0);
    let steps = (1..counts.len()).map(|level| octree(level) - octree(level - 1));
    let level = |(number, count): (usize, &Count)| {
        json!({
            "level": number,
            "octree_level": octree(number),
            "grids": count.grids,
            "cells": count.cells,
        })
    };
    Ok(json!({
        "path": path.display().to_string(),
        "kind": "simulation output",
        "format": source.format(),
        "time": hierarchy.time,
        "domain": {
            "left": hierarchy.domain.left(),
            "right": hierarchy.domain.right(),
            "root_cells": hierarchy.domain.root_cells(),
        },
        "max_level": counts.len().saturating_sub(1),
        "refinement_factors": steps.map(|steps| 1 << steps).collect::<Vec<u32>>(),
        "grids": counts.iter().map(|count| count.grids).sum::<u64>(),
        "cells": counts.iter().fold(0u64, |n, count| n.saturating_add(count.cells)),
        "levels": counts.iter().enumerate().map(level).collect::<Vec<_>>(),
        "fields": hierarchy.fields.iter().map(field_facts).collect::<Vec<_>>(),
    }))
}

fn field_facts(field: &SourceField) -> Value {
    json!({ "name": field.name, "units": field.units, "to_cgs": field.to_cgs })
}
