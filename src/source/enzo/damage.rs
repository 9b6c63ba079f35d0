//! Damaged dumps: thousands of flipped, cut and spliced files.

#[path = "../../../tests/forge/noise.rs"]
mod noise;

use self::noise::Noise;
use super::made::MadeDump;

#[test]
fn damaged_dumps_are_read_or_refused_but_never_panic() {
    let dump = MadeDump::new();
    dump.write();
    dump.write_tables();
    let files = ["", "hierarchy", "hierarchy.hdf5", "cpu0000"].map(|suffix| {
        let path = dump.path().with_extension(suffix);
        (std::fs::read(&path).unwrap(), path)
    });
    let mut noise = Noise::new(0);
    let (mut read, mut refused) = (0, 0);
    for round in 0..4000 {
        let (bytes, path) = &files[round % files.len()];
        if path == &files[1].1 {
            std::fs::remove_file(&files[2].1).unwrap();
        }
        std::fs::write(path, noise.damage(bytes)).unwrap();
        match dump.read() {
            Ok(_) => read += 1,
            Err(error) => {
                refused += 1;
                assert_eq!(error.to_string().lines().count(), 1, "{error}");
            }
        }
        std::fs::write(path, bytes).unwrap();
        std::fs::write(&files[2].1, &files[2].0).unwrap();
    }
    assert!(read > 100 && refused > 1000, "{read} read, {refused} refused");
}
