//! A serial port: 8 data bits, no parity, 1 stop bit, no flow control.

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::time::Duration;

use serialport::{ClearBuffer, SerialPort};

use super::Link;

/// A port that is open.
pub struct SerialLink {
    port: Box<dyn SerialPort>,
    baud: u32,
}

/// The rate at opening; a driver sets its own at once.
const FIRST_BAUD: u32 = 9600;

impl SerialLink {
    /// Opens `path` for this program alone.
    ///
    /// # Errors
    /// With the port's name, and what to look at.
    pub fn open(path: &str) -> io::Result<Self> {
        let port = serialport::new(path, FIRST_BAUD).timeout(Duration::from_millis(1)).open();
        let port = port.map_err(|error| {
            let error = io::Error::from(error);
            io::Error::new(error.kind(), format!("{path}: {}", in_words(&error)))
        })?;
        // What came before this moment belongs to nobody.
        let _ = port.clear(ClearBuffer::Input);
        Ok(Self { port, baud: FIRST_BAUD })
    }
}

/// What is wrong with a port, and what to do.
fn in_words(error: &io::Error) -> String {
    let text = error.to_string();
    match error.kind() {
        // On another system than Linux the group has another name, or none.
        ErrorKind::PermissionDenied => format!("{text} (on Linux: sudo usermod -aG dialout $USER, then log in again)"),
        _ if text.contains("busy") || text.contains("exclusive lock") => {
            format!("{text} (another program has it open)")
        }
        ErrorKind::NotFound => format!("{text} (is it plugged in?)"),
        // What a file is that is no terminal.
        _ if text.contains("typewriter") || text.contains("Inappropriate ioctl") || text.contains("directory") => {
            "this is not a serial port".to_owned()
        }
        _ => text,
    }
}

impl SerialLink {
    /// Puts what waits behind the `count` bytes that are in `buffer` there, too: a terminal hands over a write at a time.
    fn fill(&mut self, buffer: &mut [u8], mut count: usize) -> io::Result<usize> {
        while let Some(room @ [_, ..]) = buffer.get_mut(count..)
            && self.port.bytes_to_read().is_ok_and(|waiting| waiting > 0)
        {
            match self.port.read(room) {
                Ok(more) if more > 0 => count += more,
                // What is wrong with the port shows at the next read.
                _ => break,
            }
        }
        Ok(count)
    }
}

impl Link for SerialLink {
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.port.set_timeout(wait.max(Duration::from_millis(1)))?;
        match self.port.read(buffer) {
            // A port that is ready and has nothing is one whose far end is gone.
            Ok(0) => Err(ErrorKind::BrokenPipe.into()),
            Ok(count) => self.fill(buffer, count),
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => Ok(0),
            Err(error) => Err(error),
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port.set_timeout(Duration::from_millis(500))?;
        self.port.write_all(bytes)
    }

    fn set_baud(&mut self, baud: u32) -> io::Result<()> {
        if baud == self.baud {
            return Ok(());
        }
        self.port.flush()?;
        self.port.set_baud_rate(baud)?;
        self.baud = baud;
        Ok(())
    }

    fn set_dtr(&mut self, on: bool) -> io::Result<()> {
        self.port.write_data_terminal_ready(on).map_err(io::Error::from)
    }
}
