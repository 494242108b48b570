//! Detours: the program's own `select`, `read` and `ioctl` of ports ask the code in its clock page
//! first.
//!
//! A jump replaces one instruction of the program before the call; the jump is not longer than the
//! instruction. So each address to which the program may jump or return remains the start of an
//! instruction. A call that the page does not answer is still made at its own place.
//!
//! | found at a stop, in glibc | is replaced | after an answer |
//! |---|---|---|
//! | `mov $number, %eax` or `xor %eax, %eax`; `syscall` | `mov` | goes on behind the call |
//! | the same behind `cmpb $0, single(%rip); je ..`, first in a function | `cmpb` | returns |
//! | the same behind `mov %fs:24, %eax; test; jne ..`, before 2.34 | `mov` | returns |
//! | `mov %eax, %r8d; mov n(%rsp), %edi; xor %eax, %eax; syscall` | `mov`, `xor` | goes on behind the call |
//!
//! With several threads, `read` is a cancellation point (pthreads(7)). In this case the detours of
//! the second and third form let the function make the call itself. Its call has the fourth form,
//! and follows a check whether the thread is cancelled. No jump leads between the two instructions
//! of the fourth form.

use nix::libc;
use nix::unistd::Pid;

use super::call::INSTRUCTION;
use super::clock_page::ClockPage;
use super::memory::Memory;
use super::supervisor::poke;

/// The call instruction.
const SYSCALL: [u8; 2] = [0x0F, 0x05];
const JUMP: u8 = 0xE9;
const NOP: u8 = 0x90;
/// Calls that the page may answer.
const SERVED: [i64; 3] = [libc::SYS_read, libc::SYS_ioctl, libc::SYS_pselect6];
/// Number of bytes that are examined before a call.
const BEFORE: usize = 24;
/// Alignment of functions.
const ALIGNMENT: u64 = 16;
const ENDBR: [u8; 4] = [0xF3, 0x0F, 0x1E, 0xFA];

/// The instruction before a call that is replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Found {
    /// Number of bytes from the start of the replaced instruction to the call.
    before: u64,
    /// Length of the replaced instruction.
    len: u64,
    form: Form,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// It sets the number of the call, which follows directly.
    Number,
    /// It is the first instruction of its function, and compares with 0 the byte at this distance
    /// behind it.
    Compare(i32),
    /// It is the first instruction of its function, and reads a word of the thread.
    Thread,
    /// It follows a check whether the thread is cancelled, and reads the file number from this
    /// offset on the stack.
    Cancelled(u8),
}

/// Whether the page may answer a call of this number.
pub(super) fn is_served(number: i64) -> bool {
    SERVED.contains(&number)
}

/// Makes the program ask `page` before the call `number`, behind which `tid` stands, at `place`.
/// Returns whether the program asks the page from now on.
pub(super) fn make(tid: Pid, page: &mut ClockPage, number: i64, place: u64) -> bool {
    made(tid, page, number, place).is_some()
}

fn made(tid: Pid, page: &mut ClockPage, number: i64, place: u64) -> Option<()> {
    let call = place.checked_sub(INSTRUCTION)?;
    let from = call.checked_sub(BEFORE as u64)?;
    let mut code = [0; BEFORE + SYSCALL.len()];
    Memory(tid).read(from, &mut code).ok()?;
    let found = find(&code, number, call)?;
    let replaced = call - found.before;
    let mut taken = *page;
    let at = taken.detour(DETOUR)?;
    let detour = assemble(found, at, replaced, page.serve(), number)?;
    let mut jump = vec![NOP; usize::try_from(found.len).ok()?];
    jump[..5].copy_from_slice(&jump_to(replaced, at)?);
    // Only a tracer can write to the program's code.
    poke(tid, at, &detour).ok()?;
    poke(tid, replaced, &jump).ok()?;
    *page = taken;
    Some(())
}

/// The instruction that can be replaced in the `code` up to a call.
fn find(code: &[u8], number: i64, call: u64) -> Option<Found> {
    let before = code.strip_suffix(&SYSCALL)?;
    let number = u32::try_from(number).ok()?;
    let [a, b, c, d] = number.to_le_bytes();
    if before.ends_with(&[0xB8, a, b, c, d]) {
        return Some(Found {
            before: 5,
            len: 5,
            form: Form::Number,
        });
    }
    if number != 0 {
        return None;
    }
    if let [.., 0x41, 0x89, 0xC0, 0x8B, 0x7C, 0x24, place, 0x31, 0xC0] = *before {
        return Some(Found {
            before: 6,
            len: 6,
            form: Form::Cancelled(place),
        });
    }
    // This is `xor %eax, %eax`; compilers omit it where the word of the thread was 0.
    let short = before.strip_suffix(&[0x31, 0xC0]);
    let before = short.unwrap_or(before);
    let xor = if short.is_some() { 2 } else { 0 };
    let is_first = |before: u64, rest: &[u8]| {
        (call - before).is_multiple_of(ALIGNMENT) || rest.ends_with(&ENDBR)
    };
    if let Some([rest @ .., 0x80, 0x3D, a, b, c, d, 0, 0x74, _]) = short
        && is_first(11, rest)
    {
        return Some(Found {
            before: 11,
            len: 7,
            form: Form::Compare(i32::from_le_bytes([*a, *b, *c, *d])),
        });
    }
    let thread = [0x64, 0x8B, 0x04, 0x25, 0x18, 0, 0, 0, 0x85, 0xC0, 0x75];
    let (_, rest) = before.split_last()?;
    let rest = rest.strip_suffix(&thread)?;
    let before = 12 + xor;
    is_first(before, rest).then_some(Found {
        before,
        len: 8,
        form: Form::Thread,
    })
}

/// Maximum length of a detour, bytes.
const DETOUR: u64 = 56;
/// Number of bytes of a detour from its check of the number of threads to its last piece.
const UP_TO_LAST: u8 = 26;

/// The detour at `at`, for the instruction at `replaced`.
fn assemble(found: Found, at: u64, replaced: u64, serve: u64, number: i64) -> Option<Vec<u8>> {
    let [a, b, c, d] = u32::try_from(number).ok()?.to_le_bytes();
    let set_number = [0xB8, a, b, c, d];
    let mut code = Vec::new();
    // With several threads the function is a cancellation point, so jump directly to the last
    // piece.
    match found.form {
        Form::Number => {}
        // mov place(%rsp), %edi
        Form::Cancelled(place) => code.extend([0x8B, 0x7C, 0x24, place]),
        Form::Compare(place) => {
            // cmpb $0, place(%rip); je
            let place = (replaced + found.len).checked_add_signed(place.into())?;
            code.extend([0x80, 0x3D]);
            code.extend(distance(at + 7, place)?);
            code.extend([0, 0x74, UP_TO_LAST]);
        }
        Form::Thread => {
            // mov %fs:24, %eax; test %eax, %eax; jne
            code.extend([0x64, 0x8B, 0x04, 0x25, 0x18, 0, 0, 0]);
            code.extend([0x85, 0xC0, 0x75, UP_TO_LAST]);
        }
    }
    // lea -128(%rsp), %rsp: the program may use the memory below its stack pointer.
    code.extend([0x48, 0x8D, 0x64, 0x24, 0x80]);
    code.extend(set_number);
    // call serve
    code.push(0xE8);
    code.extend(distance(at + code.len() as u64 + 4, serve)?);
    // lea 128(%rsp), %rsp; jc over the next piece
    code.extend([0x48, 0x8D, 0xA4, 0x24, 0x80, 0, 0, 0, 0x72]);
    match found.form {
        Form::Number | Form::Cancelled(_) => {
            code.push(5);
            let behind = replaced + found.len + INSTRUCTION;
            code.extend(jump_to(at + code.len() as u64, behind)?);
            code.extend(set_number);
        }
        Form::Compare(place) => {
            // ret; cmpb $0, place(%rip)
            code.extend([1, 0xC3, 0x80, 0x3D]);
            let place = (replaced + found.len).checked_add_signed(place.into())?;
            code.extend(distance(at + code.len() as u64 + 5, place)?);
            code.push(0);
        }
        Form::Thread => {
            code.extend([1, 0xC3, 0x64, 0x8B, 0x04, 0x25, 0x18, 0, 0, 0]);
        }
    }
    code.extend(jump_to(at + code.len() as u64, replaced + found.len)?);
    debug_assert!(code.len() as u64 <= DETOUR, "{}", code.len());
    Some(code)
}

fn jump_to(at: u64, to: u64) -> Option<[u8; 5]> {
    let [a, b, c, d] = distance(at + 5, to)?;
    Some([JUMP, a, b, c, d])
}

/// The distance from the end of an instruction to its target, as the processor encodes it.
fn distance(from: u64, to: u64) -> Option<[u8; 4]> {
    let distance = to.cast_signed().checked_sub(from.cast_signed())?;
    Some(i32::try_from(distance).ok()?.to_le_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALL: u64 = 0x7FFF_F7EC_82AB;

    fn padded(end: &[u8]) -> Vec<u8> {
        let mut code = vec![0xCC; BEFORE - end.len()];
        code.extend(end);
        code.extend(SYSCALL);
        code
    }

    /// Compares with the output of a disassembler: the starts of `select` and `read` in glibc 2.36,
    /// of `read` in 2.31, and the call of a `read` with threads.
    #[test]
    fn the_instruction_before_a_call_is_replaced() {
        let select = padded(&[0x89, 0xDF, 0xB8, 0x0E, 1, 0, 0]);
        let found = find(&select, libc::SYS_pselect6, CALL).expect("known");
        assert_eq!((found.before, found.len, found.form), (5, 5, Form::Number));
        let read = [0x80, 0x3D, 0x31, 0x33, 0x0E, 0, 0, 0x74, 0x17, 0x31, 0xC0];
        let found = find(&padded(&read), libc::SYS_read, CALL).expect("known");
        assert_eq!((found.before, found.len), (11, 7));
        assert_eq!(found.form, Form::Compare(0xE_3331));
        let old = [
            0x64, 0x8B, 0x04, 0x25, 0x18, 0, 0, 0, 0x85, 0xC0, 0x75, 0x10, 0x31, 0xC0,
        ];
        let found = find(&padded(&old), libc::SYS_read, CALL + 3).expect("known");
        assert_eq!((found.before, found.len, found.form), (14, 8, Form::Thread));
        let threads = [0x41, 0x89, 0xC0, 0x8B, 0x7C, 0x24, 8, 0x31, 0xC0];
        let found = find(&padded(&threads), libc::SYS_read, CALL).expect("known");
        let form = Form::Cancelled(8);
        assert_eq!((found.before, found.len, found.form), (6, 6, form));
        assert_eq!(find(&padded(&threads[1..]), libc::SYS_read, CALL), None);
        let short = [&ENDBR[..], &old[..12]].concat();
        let found = find(&padded(&short), libc::SYS_read, CALL + 2).expect("known");
        assert_eq!((found.before, found.form), (12, Form::Thread));
    }

    /// The number of another call, an instruction inside a function, and any other code stay
    /// unchanged.
    #[test]
    fn other_code_stays() {
        let select = padded(&[0xB8, 0x0E, 1, 0, 0]);
        assert_eq!(find(&select, libc::SYS_read, CALL), None);
        assert_eq!(find(&select, libc::SYS_poll, CALL), None);
        let read = [0x80, 0x3D, 0x31, 0x33, 0x0E, 0, 0, 0x74, 0x17, 0x31, 0xC0];
        assert_eq!(find(&padded(&read), libc::SYS_read, CALL + 1), None);
        assert_eq!(find(&padded(&[0x31, 0xC0]), libc::SYS_read, CALL), None);
        assert_eq!(find(&[0xB8, 0, 0, 0, 0, 0x0F], libc::SYS_read, CALL), None);
        assert_eq!(find(&[], libc::SYS_read, CALL), None);
    }

    /// A detour that is too far away for a jump is not made. The jumps of a near one are computed
    /// by hand.
    #[test]
    fn a_detour_is_near() {
        let found = Found {
            before: 5,
            len: 5,
            form: Form::Number,
        };
        let far = assemble(found, 1 << 40, 0x40_0000, 1 << 40, 270);
        assert_eq!(far, None);
        let code = assemble(found, 0x1_0000, 0x1_1000, 0x1_0F00, 270).expect("near");
        assert_eq!(code[10..15], [0xE8, 0xF1, 0x0E, 0, 0]);
        // Behind the call, at 11007, from 1001E; to the call itself, at 11005, from 10028.
        assert_eq!(code[25..30], [JUMP, 0xE9, 0x0F, 0, 0]);
        assert_eq!(code[35..40], [JUMP, 0xDD, 0x0F, 0, 0]);
    }

    /// With several threads a detour only executes the replaced instruction. By hand: the jump
    /// behind the condition leads to the replaced instruction.
    #[test]
    fn a_program_with_threads_makes_its_call() {
        for (form, len, condition, last) in [
            (Form::Compare(0x100), 7, 9, &[0x80, 0x3D][..]),
            (
                Form::Thread,
                8,
                12,
                &[0x64, 0x8B, 0x04, 0x25, 0x18, 0, 0, 0][..],
            ),
        ] {
            let found = Found {
                before: 11,
                len,
                form,
            };
            let code = assemble(found, 0x1_0000, 0x1_1000, 0x1_0F00, 0).expect("near");
            let to = condition + usize::from(code[condition - 1]);
            assert!(code[to..].starts_with(last), "{form:?}: {code:X?}");
            assert!(code.starts_with(last), "{form:?}: {code:X?}");
            assert_eq!(code[to - 1], 0xC3, "{form:?}: ret");
        }
        // Behind the check whether the thread is cancelled: the detour has the program's own `mov`,
        // then the usual code.
        let found = Found {
            before: 6,
            len: 6,
            form: Form::Cancelled(8),
        };
        let code = assemble(found, 0x1_0000, 0x1_1000, 0x1_0F00, 0).expect("near");
        assert!(code.starts_with(&[0x8B, 0x7C, 0x24, 8, 0x48, 0x8D]));
        // Behind the call, at 11008, from 10022; to the call itself, at 11006, from 1002C.
        assert_eq!(code[29..34], [JUMP, 0xE6, 0x0F, 0, 0]);
        assert_eq!(code[39..44], [JUMP, 0xDA, 0x0F, 0, 0]);
    }

    /// The pieces by hand, with what a disassembler shows of them.
    #[test]
    fn a_detour_of_each_form_is_made_of_its_pieces() {
        let of = |before, len, form, number| {
            let found = Found { before, len, form };
            assemble(found, 0x1_0000, 0x1_1000, 0x1_0F00, number).expect("near")
        };
        let number = of(5, 5, Form::Number, 0x10E);
        let expected = [
            &[0x48, 0x8D, 0x64, 0x24, 0x80][..], // lea -128(%rsp), %rsp
            &[0xB8, 0x0E, 1, 0, 0],              // mov $270, %eax
            &[0xE8, 0xF1, 0x0E, 0, 0],           // call serve
            &[0x48, 0x8D, 0xA4, 0x24, 0x80, 0, 0, 0, 0x72, 0x05], // lea 128(%rsp), %rsp; jc
            &[0xE9, 0xE9, 0x0F, 0, 0],           // jmp behind the call
            &[0xB8, 0x0E, 1, 0, 0],              // mov $270, %eax
            &[0xE9, 0xDD, 0x0F, 0, 0],           // jmp to the call
        ];
        assert_eq!(number, expected.concat());
        let compare = of(11, 7, Form::Compare(0x100), 0);
        let expected = [
            &[0x80, 0x3D, 0, 0x11, 0, 0, 0, 0x74, 0x1A][..], // cmpb $0, place(%rip); je
            &[0x48, 0x8D, 0x64, 0x24, 0x80, 0xB8, 0, 0, 0, 0],
            &[0xE8, 0xE8, 0x0E, 0, 0],
            &[0x48, 0x8D, 0xA4, 0x24, 0x80, 0, 0, 0, 0x72, 0x01, 0xC3],
            &[0x80, 0x3D, 0xDD, 0x10, 0, 0, 0], // cmpb $0, place(%rip)
            &[0xE9, 0xD8, 0x0F, 0, 0],
        ];
        assert_eq!(compare, expected.concat());
        let thread = of(14, 8, Form::Thread, 0);
        let read = [0x64, 0x8B, 0x04, 0x25, 0x18, 0, 0, 0]; // mov %fs:24, %eax
        let expected = [
            &read[..],
            &[0x85, 0xC0, 0x75, 0x1A], // test %eax, %eax; jne
            &[0x48, 0x8D, 0x64, 0x24, 0x80, 0xB8, 0, 0, 0, 0],
            &[0xE8, 0xE5, 0x0E, 0, 0],
            &[0x48, 0x8D, 0xA4, 0x24, 0x80, 0, 0, 0, 0x72, 0x01, 0xC3],
            &read,
            &[0xE9, 0xD5, 0x0F, 0, 0],
        ];
        assert_eq!(thread, expected.concat());
    }

    /// A jump has 32 bits, signed, and counts from its end.
    #[test]
    fn a_distance_has_32_bits() {
        assert_eq!(distance(0x1000, 0x1005), Some([5, 0, 0, 0]));
        assert_eq!(distance(0x1005, 0x1000), Some([0xFB, 0xFF, 0xFF, 0xFF]));
        let far = 1_u64 << 31;
        assert_eq!(distance(0, far - 1), Some([0xFF, 0xFF, 0xFF, 0x7F]));
        assert_eq!(distance(0, far), None);
        assert_eq!(distance(far, 0), Some([0, 0, 0, 0x80]));
        assert_eq!(distance(far + 1, 0), None);
        assert_eq!(jump_to(0x1000, 0x1005), Some([0xE9, 0, 0, 0, 0]));
        let found = Found {
            before: 5,
            len: 5,
            form: Form::Number,
        };
        assert_eq!(assemble(found, 0, 1 << 40, 1 << 41, 0), None);
        for number in [libc::SYS_read, libc::SYS_ioctl, libc::SYS_pselect6] {
            assert!(is_served(number));
        }
        assert!(!is_served(libc::SYS_write) && !is_served(libc::SYS_select));
    }

    /// Where a function begins: at a multiple of 16, or behind `endbr64`.
    #[test]
    fn a_function_begins_at_a_multiple_of_16() {
        let read = [0x80, 0x3D, 0x31, 0x33, 0x0E, 0, 0, 0x74, 0x17, 0x31, 0xC0];
        let with_endbr = [&ENDBR[..], &read].concat();
        for call in CALL + 1..CALL + 16 {
            assert_eq!(find(&padded(&read), 0, call), None, "{call:x}");
            assert!(find(&padded(&with_endbr), 0, call).is_some(), "{call:x}");
        }
        assert!(find(&padded(&read), 0, CALL + 16).is_some());
        let old = [
            0x64, 0x8B, 0x04, 0x25, 0x18, 0, 0, 0, 0x85, 0xC0, 0x75, 0x10,
        ];
        let long = [&old[..], &[0x31, 0xC0]].concat();
        for offset in 0..16 {
            let place = 0x7FFF_F7EC_8200 + offset;
            assert_eq!(
                find(&padded(&long), 0, place).is_some(),
                offset == 14,
                "{offset}"
            );
            assert_eq!(
                find(&padded(&old), 0, place).is_some(),
                offset == 12,
                "{offset}"
            );
        }
    }
}
