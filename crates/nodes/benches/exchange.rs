//! Benchmark: the number of exchanges per second with a node program in C and in Python.
//!
//! Each iteration is one exchange with a byte: a request is written to the program's pipe, and its
//! answer is read. Run it with `cargo bench -p hilrig-nodes`.

use std::path::{Path, PathBuf};
use std::process::Command;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nodes::host::Host;
use nodes::{Input, Item, NodePort, NodeSpec};
use protocols::{Instant, LineConfig};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The command of the C program, if there is a compiler.
fn compiled() -> Option<String> {
    let out = std::env::temp_dir().join(format!("hilrig-bench-echo-{}", std::process::id()));
    let source = root().join("nodes/examples/echo.c");
    let status = Command::new("cc")
        .arg("-O2")
        .arg(source)
        .arg("-o")
        .arg(&out)
        .status();
    let is_made = status.is_ok_and(|status| status.success());
    is_made.then(|| out.display().to_string())
}

fn exchange(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("exchange");
    group.throughput(Throughput::Elements(1));
    let python = format!(
        "python3 {}",
        root().join("nodes/examples/echo.py").display()
    );
    let library = root().join("python/src").display().to_string();
    let programs = [("c", compiled()), ("python", Some(python))];
    for (name, command) in programs {
        let Some(command) = command else {
            eprintln!("exchange/{name}: skipped, there is no C compiler");
            continue;
        };
        let spec = NodeSpec {
            ports: vec![NodePort::uart("uart", LineConfig::new_8n1(115_200))],
            env: vec![("PYTHONPATH".to_owned(), library.clone())],
            ..NodeSpec::new("echo", &command)
        };
        let mut host = Host::start(&spec).expect("a greeting");
        let mut now = Instant::ZERO;
        group.bench_function(name, |bench| {
            bench.iter(|| {
                now += core::time::Duration::from_millis(2);
                let byte = Item {
                    port: 0,
                    at: now,
                    what: Input::Bytes(vec![b'x']),
                };
                host.exchange(now, &[byte]).expect("an answer")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, exchange);
criterion_main!(benches);
