//! How the system's allocator deals with threads.

/// Arenas that all threads share. Of what is freed in one, nothing is of use in another, nor to the
/// system while something above it is in use: with an arena for each of many threads, bricks that one
/// thread makes and another one lets go of take twice their room.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const ARENAS: libc::c_int = 2;

/// Has threads share what they free, unless the user has said in how many arenas. Call it before any
/// other thread is started.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)]
pub(crate) fn share_among_threads() {
    if std::env::var_os("MALLOC_ARENA_MAX").is_none() {
        // SAFETY: `mallopt` takes two numbers and has no other conditions; what it refuses changes
        // nothing.
        unsafe { libc::mallopt(libc::M_ARENA_MAX, ARENAS) };
    }
}

/// Other allocators are left to themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) fn share_among_threads() {}
