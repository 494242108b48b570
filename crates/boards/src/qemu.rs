//! Machines of QEMU: which boards run there, and the command that starts them.

use std::env;
use std::ffi::OsString;
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use serde::Deserialize;

/// Name of QEMU's program.
const NAME: &str = "qemu-system-arm";
/// Environment variable with the path of another program to use instead.
const VARIABLE: &str = "HILRIG_QEMU_ARM";

/// The machine of QEMU that runs a board's firmware.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Name of the machine, as QEMU's option `-M` accepts it.
    pub machine: String,
    /// Kind of firmware that the machine runs.
    pub firmware: Tier,
}

/// Kind of firmware that a machine of QEMU runs, and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tier {
    /// Programs linked with the board layer `nodes/cortex-m4`, in lockstep with the rig.
    Lockstep,
    /// Any firmware, unmodified, in real time.
    RealTime,
}

/// QEMU's option for a UART without a port.
const NO_SERIAL: &str = " -serial null";

impl Machine {
    /// Shell command of the node program that runs `elf`. `words` is its command line; it waits for
    /// gdb on the TCP port `gdb`.
    ///
    /// # Errors
    /// If QEMU is missing, or a word cannot be passed.
    pub fn lockstep(
        &self,
        elf: &str,
        words: &[String],
        gdb: Option<u16>,
    ) -> Result<String, String> {
        // QEMU joins the words by blanks.
        let wrong = words.iter().find(|word| word.contains(char::is_whitespace));
        if let Some(word) = wrong {
            return Err(format!(
                "\"{}\" cannot be passed to firmware in QEMU, expected a text without blanks",
                word.escape_debug()
            ));
        }
        let words: String = words
            .iter()
            .map(|word| format!(",arg={}", word.replace(',', ",,")))
            .collect();
        let told = quoted(&format!("enable=on,target=native,arg=firmware{words}"));
        let gdb = gdb.map_or(String::new(), |port| format!(" -gdb tcp::{port} -S"));
        Ok(format!(
            "{} -serial none -icount shift=2,sleep=off -semihosting-config {told}{gdb}",
            self.start(elf)?
        ))
    }

    /// Shell command that runs `elf` in real time. `ports` are the numbers of UARTs with the names
    /// of the variables that hold their ports.
    ///
    /// # Errors
    /// If QEMU is missing.
    pub fn real_time(&self, elf: &str, ports: &[(u8, String)]) -> Result<String, String> {
        let mut opened = String::new();
        let mut serials = String::new();
        let most = ports.iter().map(|(number, _)| *number).max().unwrap_or(0);
        for number in 0..=most {
            let port = ports.iter().find(|(known, _)| *known == number);
            let Some((_, variable)) = port else {
                serials += NO_SERIAL;
                continue;
            };
            // QEMU's own backend for serial ports would set 115200 baud; the backend for pipes sets
            // nothing. A port that is named by the number of its file descriptor may have any path.
            // The port already has the rate of its line, and `stty` does not know all rates, so the
            // rate is not set here.
            let fd = 3 + number;
            opened += &format!(
                "exec {fd}<>\"${variable}\" && stty cs8 -parenb -cstopb raw -echo <&{fd} && "
            );
            serials +=
                &format!(" -chardev pipe,id=u{number},path=/dev/fd/{fd} -serial chardev:u{number}");
        }
        Ok(format!("{opened}{}{serials}", self.start(elf)?))
    }

    fn start(&self, elf: &str) -> Result<String, String> {
        let qemu = find()?;
        // QEMU does not notice the end of this process while gdb holds QEMU, or while its program
        // computes. `setpriv` ends QEMU then; it belongs to util-linux, which is part of each usual
        // Linux.
        let bound = match find_program("setpriv", env::var_os("PATH")) {
            Some(_) => "setpriv --pdeathsig KILL ",
            None => "",
        };
        Ok(format!(
            "exec {bound}{} -M {} -kernel {} -display none -monitor none -parallel none -nic none",
            quoted(&qemu.to_string_lossy()),
            quoted(&self.machine),
            quoted(elf),
        ))
    }
}

/// Checks that `elf` is an image for a Cortex-M.
///
/// # Errors
/// A sentence, if it cannot be read or is another file.
pub fn check_image(elf: &Path) -> Result<(), String> {
    let mut head = Vec::new();
    let read = File::open(elf).and_then(|file| file.take(20).read_to_end(&mut head));
    read.map_err(|error| format!("{}: {error}", elf.display()))?;
    check_head(&head).map_err(|wrong| format!("{}: {wrong}", elf.display()))
}

/// Checks the first bytes of an image: 32 bits, little endian, machine 40 (Arm).
fn check_head(head: &[u8]) -> Result<(), String> {
    match head {
        [0x7F, b'E', b'L', b'F', 1, 1, .., 40, 0] if head.len() == 20 => Ok(()),
        [0x7F, b'E', b'L', b'F', .., low, high] if head.len() == 20 => Err(format!(
            "was built for another processor (ELF machine {}), expected one for Arm, 32 bits",
            u16::from_le_bytes([*low, *high])
        )),
        _ => Err("not an ELF file; give the .elf, not the .hex or .bin".to_owned()),
    }
}

/// `text` as one word for the shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// The emulator.
fn find() -> Result<PathBuf, String> {
    find_in(env::var_os(VARIABLE), env::var_os("PATH"))
}

fn is_program(path: &Path) -> bool {
    path.metadata()
        .is_ok_and(|known| known.is_file() && known.permissions().mode() & 0o111 != 0)
}

fn find_program(name: &str, path: Option<OsString>) -> Option<PathBuf> {
    let folders = path.iter().flat_map(env::split_paths);
    let mut found = folders.map(|folder| folder.join(name));
    found.find(|path| is_program(path))
}

fn find_in(named: Option<OsString>, path: Option<OsString>) -> Result<PathBuf, String> {
    if let Some(named) = named.map(PathBuf::from) {
        return match is_program(&named) {
            true => Ok(named),
            false => Err(format!(
                "{VARIABLE} names {}, which is no program",
                named.display()
            )),
        };
    }
    find_program(NAME, path).ok_or_else(|| {
        format!(
            "{NAME} is missing: apt install {NAME} (Debian, Ubuntu); elsewhere install QEMU 7.2 or \
             later, or name the program in {VARIABLE}"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_emulator_names_the_package() {
        let missing = find_in(None, Some("/nowhere:/etc".into())).expect_err("is not there");
        assert!(
            missing.starts_with("qemu-system-arm is missing: apt install qemu-system-arm"),
            "{missing}"
        );
        let named = find_in(Some("/etc/passwd".into()), None).expect_err("is no program");
        assert_eq!(
            named,
            "HILRIG_QEMU_ARM names /etc/passwd, which is no program"
        );
        let shell = find_in(Some("/bin/sh".into()), None);
        assert_eq!(shell, Ok(PathBuf::from("/bin/sh")));
    }

    /// Machines of the ELF specification: 40 is Arm, 62 x86-64, 83 AVR.
    #[test]
    fn an_image_for_another_processor_is_refused() {
        let head = |class: u8, machine: u8| {
            let mut head = b"\x7FELF".to_vec();
            head.extend([class, 1, 1]);
            head.resize(16, 0);
            head.extend([2, 0, machine, 0]);
            head
        };
        assert_eq!(check_head(&head(1, 40)), Ok(()));
        for (wrong, sentence) in [
            (
                head(2, 62),
                "was built for another processor (ELF machine 62)",
            ),
            (
                head(1, 83),
                "was built for another processor (ELF machine 83)",
            ),
            (
                head(2, 40),
                "was built for another processor (ELF machine 40)",
            ),
            (head(1, 40)[..19].to_vec(), "not an ELF file"),
            (b"\x7FELF\x01\x01\x28\x00".to_vec(), "not an ELF file"),
            (b":10000000".to_vec(), "not an ELF file"),
            (Vec::new(), "not an ELF file"),
        ] {
            let said = check_head(&wrong).expect_err(sentence);
            assert!(said.starts_with(sentence), "{said}");
        }
    }

    #[test]
    fn the_words_of_a_firmware_stay_words() {
        let machine = Machine {
            machine: "mps2-an386".to_owned(),
            firmware: Tier::Lockstep,
        };
        let blank = machine.lockstep("a.elf", &["port=a b:1".to_owned()], None);
        assert!(blank.is_err_and(|error| error.contains("expected a text without blanks")));
        let Ok(_) = find() else {
            // Without QEMU there is no command.
            return;
        };
        let ports = [(2, "HILRIG_PORT_GPS".to_owned())];
        let command = machine.real_time("a.elf", &ports).expect("QEMU is there");
        assert!(
            command.starts_with("exec 5<>\"$HILRIG_PORT_GPS\" && stty cs8 "),
            "{command}"
        );
        let serials =
            "-serial null -serial null -chardev pipe,id=u2,path=/dev/fd/5 -serial chardev:u2";
        assert!(command.ends_with(serials), "{command}");
        let command = machine.lockstep("it's.elf", &["a=1,2".to_owned()], Some(3333));
        let command = command.expect("QEMU is there");
        for part in [
            "-kernel 'it'\\''s.elf'",
            "'enable=on,target=native,arg=firmware,arg=a=1,,2'",
            "-gdb tcp::3333 -S",
        ] {
            assert!(command.contains(part), "{command}");
        }
    }
}
