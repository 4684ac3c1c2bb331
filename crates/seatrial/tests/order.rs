//! The order of the groups: `lib.rs` lists them as they are read, and each uses only itself and those before it.

use std::fs;
use std::path::{Path, PathBuf};

/// The Rust files under a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder of sources");
    let paths = entries.map(|entry| entry.expect("an entry of it").path());
    paths.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// The groups in the order of the table in `lib.rs`.
fn groups(lib: &str) -> Vec<&str> {
    let rows = lib.lines().filter_map(|line| line.strip_prefix("//! | "));
    rows.filter_map(|row| row.trim_start_matches('[').strip_prefix('`')?.split('`').next()).collect()
}

#[test]
fn law_a_group_uses_only_groups_before_it() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../seatrial/src");
    let lib = fs::read_to_string(source.join("lib.rs")).expect("lib.rs");
    let groups = groups(&lib);
    let declared = lib.lines().filter(|line| line.contains("mod ")).count();
    assert_eq!(groups.len(), declared, "the table of lib.rs lists each group once: {groups:?}");
    for path in files(&source) {
        let name = path.strip_prefix(&source).expect("a path in the sources").to_string_lossy().into_owned();
        let own = name.split('/').next().expect("a first part").trim_end_matches(".rs").to_owned();
        let Some(rank) = groups.iter().position(|group| *group == own) else { continue };
        let text = fs::read_to_string(&path).expect("a source");
        for line in text.lines().map(|line| line.split("//").next().unwrap_or_default()) {
            for used in line.split("crate::").skip(1) {
                let used =
                    used.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap_or_default();
                let used_rank = groups.iter().position(|group| *group == used);
                assert!(
                    used_rank.is_none_or(|used| used <= rank),
                    "{name} uses {used}, which comes after it"
                );
            }
        }
    }
}
