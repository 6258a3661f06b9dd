//! The program's allocator: mimalloc with a limit. Where memory ends, the program ends with one line and exit code 1 instead
//! of a signal.
//!
//! Each thread counts its own allocations and adds them to the common count in batches, so that the count costs nothing that
//! can be measured. It is right to `BATCH_BYTES` per thread.

use mimalloc::MiMalloc;
use std::alloc::{GlobalAlloc, Layout};
use std::cell::Cell;
use std::io::Write;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicIsize, AtomicUsize};

/// Changes that a thread collects before it adds them to the common count.
const BATCH_BYTES: isize = 64 << 10;

static LIMIT_BYTES: AtomicUsize = AtomicUsize::new(usize::MAX);
static USED_BYTES: AtomicIsize = AtomicIsize::new(0);
static IS_ENDING: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// Bytes that are not in [`USED_BYTES`] yet.
    static PENDING_BYTES: Cell<isize> = const { Cell::new(0) };
    /// Whether this thread ends the program.
    static ENDS_PROGRAM: Cell<bool> = const { Cell::new(false) };
}

/// Ends the program when more than `bytes` are allocated.
pub fn set_limit(bytes: u64) {
    LIMIT_BYTES.store(usize::try_from(bytes).unwrap_or(usize::MAX), Relaxed);
}

/// mimalloc with a limit; see [`set_limit`].
pub struct LimitedAllocator;

// SAFETY: every call is passed on to mimalloc unchanged, and nothing in between unwinds.
unsafe impl GlobalAlloc for LimitedAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: as the caller promises.
        allocated(unsafe { MiMalloc.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: as the caller promises.
        allocated(unsafe { MiMalloc.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, bytes: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize - layout.size() as isize);
        // SAFETY: as the caller promises.
        allocated(unsafe { MiMalloc.realloc(bytes, layout, size) }, size)
    }

    unsafe fn dealloc(&self, bytes: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: as the caller promises.
        unsafe { MiMalloc.dealloc(bytes, layout) }
    }
}

/// Counts a change, and ends the program if the limit is exceeded.
fn count(change: isize) {
    // A thread that is ending has no count any more.
    let _ = PENDING_BYTES.try_with(|pending| {
        let sum = pending.get() + change;
        if sum.abs() < BATCH_BYTES {
            pending.set(sum);
            return;
        }
        pending.set(0);
        let used = USED_BYTES.fetch_add(sum, Relaxed) + sum;
        let limit = LIMIT_BYTES.load(Relaxed);
        if sum > 0 && usize::try_from(used).is_ok_and(|used| used > limit) {
            end_program(format_args!("more than the limit of {} MiB is needed", limit >> 20));
        }
    });
}

fn allocated(bytes: *mut u8, size: usize) -> *mut u8 {
    if bytes.is_null() {
        end_program(format_args!("the system refuses {size} bytes"));
    }
    bytes
}

/// Prints why, and ends the program. Returns to the thread that is in it already, so that it may allocate a little.
#[cold]
fn end_program(why: std::fmt::Arguments<'_>) {
    if ENDS_PROGRAM.with(|ends| ends.replace(true)) {
        return;
    }
    if IS_ENDING.swap(true, Relaxed) {
        // Another thread is ending the program.
        loop {
            std::thread::sleep(std::time::Duration::from_secs(1));
        }
    }
    let mut line = [0u8; 512];
    let mut rest = &mut line[..];
    let _ = write!(rest, "error: ");
    #[cfg(feature = "bake")]
    insula_source::subject::write(&mut rest);
    let _ = writeln!(rest, "out of memory: {why}; raise --memory if the command has it, or split the input");
    let unused = rest.len();
    print_and_exit(&line[..line.len() - unused]);
}

/// Without standard error's lock, which the thread may hold, and without exit handlers, which may wait for other threads.
#[cfg(unix)]
fn print_and_exit(line: &[u8]) -> ! {
    use std::fs::File;
    use std::mem::ManuallyDrop;
    use std::os::fd::FromRawFd;
    unsafe extern "C" {
        fn _exit(code: i32) -> !;
    }
    // SAFETY: the file is not closed, and descriptor 2 is standard error.
    let mut error = ManuallyDrop::new(unsafe { File::from_raw_fd(2) });
    let _ = error.write_all(line);
    remove_temporary();
    // SAFETY: POSIX's function has no preconditions.
    unsafe { _exit(1) }
}

#[cfg(not(unix))]
fn print_and_exit(line: &[u8]) -> ! {
    let _ = std::io::stderr().write_all(line);
    remove_temporary();
    std::process::exit(1)
}

/// Removes copies of inputs, after the line: this allocates a little.
fn remove_temporary() {
    #[cfg(feature = "bake")]
    insula_source::temporary::remove_all_unless_busy();
}
