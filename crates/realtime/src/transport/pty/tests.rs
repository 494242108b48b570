use std::fs::File;

use protocols::LineConfig;

use super::{Pty, Transport as _};
use crate::transport::PortDir;

/// The supervisor reports what its program does: without a report the kernel is not queried.
#[test]
fn a_modelled_port_does_not_query_the_kernel_about_reads() {
    let name = format!("hilrig-modelled-{}", std::process::id());
    let path = std::env::temp_dir().join(name);
    let dir = PortDir::open(&path).expect("a free name");
    let mut port = Pty::open(&dir, "lidar", LineConfig::new_8n1(115_200)).expect("a free name");
    port.model();
    let client = File::open(port.path()).expect("a port");
    assert!(port.is_drained() && !port.is_open(), "a query");
    assert_eq!(port.read(&mut [0; 16]).expect("stays"), 0);
    assert!(port.is_open());

    assert_eq!(port.write(b"abc"), 3);
    assert!(!port.is_drained());
    assert_eq!(port.reads(), Some(0));
    assert_eq!(port.terminal.take(3).as_deref(), Some(&b"abc"[..]));
    port.terminal.correct_unread(0);
    assert!(port.is_drained());
    assert_eq!(port.reads(), Some(1));

    drop((client, port, dir));
    let _ = std::fs::remove_dir_all(path);
}
