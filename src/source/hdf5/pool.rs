//! A bounded number of open files.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::File;
use crate::Result;

/// Most files kept open: a run can have thousands.
const MOST_OPEN: usize = 64;
/// Bytes that open files keep of decoded values, at most; those of one file, if it keeps more.
const MOST_CACHED: usize = 32 << 20;
/// Files are opened afresh after this many uses, because the library remembers every object it
/// has met (about 2 kB each) for as long as the file is open. It lists a file's groups anew then, which
/// takes long where one file holds many grids: the fewer uses, the more often.
const MOST_USES: u32 = 4096;

/// Open files, the longest unused closed first.
#[derive(Default)]
pub struct Pool {
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The latest used last.
    files: Vec<(PathBuf, Arc<File>)>,
    uses: u32,
}

impl State {
    /// Closes the longest unused of the files that keep decoded values, if all keep too much.
    fn close_some(&mut self) {
        let mut kept: usize = self.files.iter().map(|(_, file)| file.cached_bytes()).sum();
        while kept > MOST_CACHED {
            let others = &self.files[..self.files.len() - 1];
            let keeps = |(_, file): &(PathBuf, Arc<File>)| file.cached_bytes() > 0;
            let Some(oldest) = others.iter().position(keeps) else { return };
            kept -= self.files.remove(oldest).1.cached_bytes();
        }
    }
}

impl Pool {
    /// The file at `path`, opened if it is not open.
    ///
    /// # Errors
    /// What [`File::open`] refuses.
    pub fn get(&self, path: &Path) -> Result<Arc<File>> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.uses += 1;
        if state.uses > MOST_USES {
            state.files.clear();
            state.uses = 0;
        }
        state.close_some();
        if let Some(at) = state.files.iter().position(|(open, _)| open == path) {
            let entry = state.files.remove(at);
            let file = Arc::clone(&entry.1);
            state.files.push(entry);
            return Ok(file);
        }
        let file = Arc::new(File::open(path)?);
        if state.files.len() == MOST_OPEN {
            state.files.remove(0);
        }
        state.files.push((path.to_path_buf(), Arc::clone(&file)));
        Ok(file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_files_stay_open_and_the_latest_used_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<PathBuf> = (0..MOST_OPEN + 4)
            .map(|i| {
                let path = folder.path().join(format!("{i}.h5"));
                let mut builder = hdf5_pure::FileBuilder::new();
                builder.create_dataset("one").with_i32_data(&[i32::try_from(i).unwrap()]);
                builder.write(&path).unwrap();
                path
            })
            .collect();
        let pool = Pool::default();
        let first = pool.get(&paths[0]).unwrap();
        for path in &paths {
            pool.get(path).unwrap();
            assert!(Arc::ptr_eq(&first, &pool.get(&paths[0]).unwrap()));
        }
        assert_eq!(pool.state.lock().unwrap().files.len(), MOST_OPEN);
        assert!(pool.get(&folder.path().join("absent.h5")).is_err());
    }

    #[cfg(not(feature = "libhdf5"))]
    #[test]
    fn files_that_keep_much_are_closed() {
        let folder = tempfile::tempdir().unwrap();
        let pool = Pool::default();
        for name in ["a.h5", "b.h5", "c.h5"] {
            let path = folder.path().join(name);
            let mut builder = hdf5_pure::FileBuilder::new();
            let values = builder.create_dataset("values").with_f64_data(&vec![1.0; 1 << 19]);
            values.with_shape(&[1 << 10, 1 << 9]).with_chunks(&[1 << 10, 1 << 9]).with_shuffle();
            builder.write(&path).unwrap();
            let file = pool.get(&path).unwrap();
            file.read_f64("/values", &[0, 0], &[1 << 10, 1 << 9], &mut vec![0.0; 1 << 19]).unwrap();
        }
        let names = || -> Vec<_> {
            let state = pool.state.lock().unwrap();
            state.files.iter().map(|(path, _)| path.file_name().unwrap().to_owned()).collect()
        };
        assert_eq!(
            names(),
            ["b.h5", "c.h5"],
            "one that keeps much, and the one that was asked for"
        );
        pool.get(&folder.path().join("b.h5")).unwrap();
        assert_eq!(names(), ["c.h5", "b.h5"]);
    }

    #[test]
    fn what_the_library_remembers_is_let_go_after_many_uses() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        let mut builder = hdf5_pure::FileBuilder::new();
        builder.create_dataset("one").with_i32_data(&[1]);
        builder.write(&path).unwrap();
        let pool = Pool::default();
        let first = pool.get(&path).unwrap();
        for _ in 0..MOST_USES {
            pool.get(&path).unwrap();
        }
        assert!(!Arc::ptr_eq(&first, &pool.get(&path).unwrap()));
    }
}
