//! Part programs: `trunnion.nc`.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trunnion_core::Error;
use trunnion_core::nc::contour::contour_blocks;
use trunnion_core::nc::follow::{moves, moves_of};
use trunnion_core::nc::path::{FeedMode, Motion, Plane, Position, Side, Start};
use trunnion_core::nc::{Dialect, Item, Program};

use crate::arrays::{array, finite, matrix, text};
use crate::errors::{IntoPy, to_py};

/// A part program: blocks of words and comments in the spelling of a dialect.
#[pyclass(name = "Program", module = "trunnion.nc", frozen, eq)]
#[derive(Clone, PartialEq)]
pub struct PyProgram {
    pub inner: Program,
}

/// A block for [`PyProgram::from_blocks`]: a comment, or words.
#[derive(FromPyObject)]
enum BlockArgument {
    Comment(String),
    Words(Vec<(char, f64)>),
}

#[pymethods]
impl PyProgram {
    #[staticmethod]
    fn parse(
        py: Python<'_>,
        #[pyo3(from_py_with = text)] text: String,
        #[pyo3(from_py_with = text)] dialect: String,
    ) -> PyResult<Self> {
        let inner = py
            .detach(|| {
                dialect.parse::<Dialect>().and_then(|dialect| Program::parse(&text, dialect))
            })
            .into_py()?;
        Ok(Self { inner })
    }

    #[staticmethod]
    fn from_blocks(dialect: &str, blocks: Vec<BlockArgument>) -> PyResult<Self> {
        let mut inner = Program::new(dialect.parse().into_py()?);
        for block in blocks {
            match block {
                BlockArgument::Comment(text) => inner.push_comment(&text),
                BlockArgument::Words(words) => inner.push(&words),
            }
            .into_py()?;
        }
        Ok(Self { inner })
    }

    #[getter]
    fn dialect(&self) -> &'static str {
        self.inner.dialect.name()
    }

    fn text(&self, py: Python<'_>) -> String {
        py.detach(|| self.inner.emit())
    }

    fn words(&self, block: usize) -> PyResult<Vec<(char, f64, u32, u32)>> {
        let block = self.inner.blocks.get(block).ok_or_else(|| {
            let expected = format!("below {}", self.inner.blocks.len());
            to_py(&Error::input("block", block, expected))
        })?;
        Ok(block
            .words()
            .map(|word| (word.letter, word.number.value(), word.span.line, word.span.column))
            .collect())
    }

    fn comments(&self) -> Vec<(usize, String)> {
        let blocks = self.inner.blocks.iter().enumerate();
        blocks
            .flat_map(|(index, block)| block.items.iter().map(move |item| (index, item)))
            .filter_map(|(index, item)| match item {
                Item::Comment(text) | Item::Remark(text) => Some((index, text.clone())),
                _ => None,
            })
            .collect()
    }

    fn contour_blocks(&self) -> PyResult<Option<(usize, usize)>> {
        Ok(contour_blocks(&self.inner).into_py()?.map(|range| (range.start, range.end)))
    }

    #[pyo3(signature = (*, blocks = None, start = None, feed = None, machine_codes = Vec::new()))]
    fn path<'py>(
        &self,
        py: Python<'py>,
        blocks: Option<(usize, usize)>,
        #[pyo3(from_py_with = finite)] start: Option<[f64; 6]>,
        #[pyo3(from_py_with = finite)] feed: Option<f64>,
        machine_codes: Vec<(char, f64)>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let start = Start { position: start.map(|axes| Position { axes }), feed, machine_codes };
        let path = py
            .detach(|| match blocks {
                None => moves(&self.inner, &start),
                Some((first, end)) => moves_of(&self.inner, first..end, &start),
            })
            .into_py()?;
        let each = path.moves.iter();
        let dict = PyDict::new(py);
        let rows = |of: fn(&trunnion_core::nc::path::Move) -> Position| -> PyResult<Bound<'py, PyArray2<f64>>> {
            matrix(py, each.clone().flat_map(|m| of(m).axes).collect(), 6)
        };
        let small = |of: fn(&trunnion_core::nc::path::Move) -> i64| -> Bound<'py, PyArray1<i64>> {
            PyArray1::from_iter(py, each.clone().map(of))
        };
        dict.set_item("begin", array(py, path.start.axes.to_vec())?)?;
        dict.set_item("start", rows(|m| m.from)?)?;
        dict.set_item("end", rows(|m| m.to)?)?;
        let centres = each.clone().flat_map(|m| match m.motion {
            Motion::Arc { centre, .. } => centre,
            _ => [0.0; 2],
        });
        dict.set_item("centre", matrix(py, centres.collect(), 2)?)?;
        dict.set_item("feed", array(py, each.clone().map(|m| m.feed).collect())?)?;
        dict.set_item("code", small(|m| code(m.motion)))?;
        dict.set_item("plane", small(|m| plane(m.motion)))?;
        dict.set_item("feed_mode", small(|m| feed_mode(m.feed_mode)))?;
        dict.set_item("side", small(|m| side(m.side)))?;
        dict.set_item("block", PyArray1::from_iter(py, each.clone().map(|m| m.block as u64)))?;
        dict.set_item("line", small(|m| i64::from(m.span.line)))?;
        dict.set_item("column", small(|m| i64::from(m.span.column)))?;
        Ok(dict)
    }

    fn __len__(&self) -> usize {
        self.inner.blocks.len()
    }

    fn __repr__(&self) -> String {
        format!("Program({} blocks, {:?})", self.inner.blocks.len(), self.inner.dialect.name())
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (String, &'static str))> {
        let this = slf.get();
        Ok((slf.get_type().getattr("parse")?, (this.inner.emit(), this.dialect())))
    }
}

fn code(motion: Motion) -> i64 {
    match motion {
        Motion::Rapid => 0,
        Motion::Feed => 1,
        Motion::Arc { clockwise: true, .. } => 2,
        Motion::Arc { clockwise: false, .. } => 3,
        Motion::Probe => 38,
    }
}

fn plane(motion: Motion) -> i64 {
    match motion {
        Motion::Arc { plane: Plane::Xy, .. } => 17,
        Motion::Arc { plane: Plane::Zx, .. } => 18,
        Motion::Arc { plane: Plane::Yz, .. } => 19,
        _ => 0,
    }
}

fn feed_mode(mode: FeedMode) -> i64 {
    match mode {
        FeedMode::InverseTime => 93,
        FeedMode::PerMinute => 94,
        FeedMode::PerRevolution => 95,
    }
}

fn side(side: Side) -> i64 {
    match side {
        Side::On => 40,
        Side::Left => 41,
        Side::Right => 42,
    }
}
