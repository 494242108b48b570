//! `embedded-io` and `embedded-io-async` in both common versions. Errors are those of [`std::io`].

use core::future::poll_fn;
use std::io;

use crate::VirtualPort;

macro_rules! implement {
    ($blocking:ident, $waiting:ident) => {
        impl $blocking::ErrorType for VirtualPort {
            type Error = io::Error;
        }

        impl $blocking::Read for VirtualPort {
            fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
                io::Read::read(self, buf)
            }
        }

        impl $blocking::Write for VirtualPort {
            fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
                io::Write::write(self, buf)
            }

            fn flush(&mut self) -> io::Result<()> {
                io::Write::flush(self)
            }
        }

        impl $blocking::ReadReady for VirtualPort {
            fn read_ready(&mut self) -> io::Result<bool> {
                self.available().map(|len| len > 0)
            }
        }

        impl $blocking::WriteReady for VirtualPort {
            fn write_ready(&mut self) -> io::Result<bool> {
                let mut turn = self.bench.core.enter()?;
                let (run, port) = turn.port(self.index)?;
                let has_room = port.room(run) > 0;
                turn.asked()?;
                Ok(has_room)
            }
        }

        impl $waiting::Read for VirtualPort {
            async fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
                poll_fn(|cx| self.poll_read(cx, buf)).await
            }
        }

        impl $waiting::Write for VirtualPort {
            async fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
                poll_fn(|cx| self.poll_write(cx, buf)).await
            }

            async fn flush(&mut self) -> io::Result<()> {
                poll_fn(|cx| self.poll_flush(cx)).await
            }
        }
    };
}

implement!(embedded_io, embedded_io_async);
implement!(embedded_io_06, embedded_io_async_06);
