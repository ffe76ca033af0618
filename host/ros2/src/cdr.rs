//! Fields written in CDR, as ROS 2 has them.
//!
//! Four bytes of head, then little-endian fields, each at a multiple of its size behind the head; texts and sequences have their length
//! before them. Source: OMG DDSI-RTPS 10.2. What reads them is `lrfslam_host::scans::bags`.

/// A message under way.
pub(crate) struct Cdr {
    bytes: Vec<u8>,
}

/// Plain CDR, little-endian.
const HEAD: [u8; 4] = [0, 1, 0, 0];

impl Cdr {
    pub fn new() -> Self {
        Self { bytes: HEAD.to_vec() }
    }

    /// Head and fields.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        let at = self.bytes.len() - HEAD.len();
        self.bytes.resize(HEAD.len() + at.next_multiple_of(N), 0);
        self.bytes.extend(bytes);
        self
    }

    pub fn i32(&mut self, value: i32) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    pub fn f32(&mut self, value: f32) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    pub fn f64(&mut self, value: f64) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// As many as the type has: nothing says how many.
    pub fn f64s(&mut self, values: impl IntoIterator<Item = f64>) -> &mut Self {
        values.into_iter().for_each(|value| {
            self.f64(value);
        });
        self
    }

    /// A sequence.
    pub fn f32s(&mut self, values: &[f32]) -> &mut Self {
        self.length(values.len());
        values.iter().for_each(|value| {
            self.f32(*value);
        });
        self
    }

    /// A sequence.
    pub fn i8s(&mut self, values: impl ExactSizeIterator<Item = i8>) -> &mut Self {
        self.length(values.len());
        self.bytes.extend(values.map(|value| value as u8));
        self
    }

    /// With a 0 at its end, which counts.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.length(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
        self
    }

    /// No message of ours comes near the largest.
    fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).unwrap_or(u32::MAX));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_stand_at_multiples_of_their_size_behind_the_head() {
        let mut message = Cdr::new();
        message.text("ab").f64(1.0).i8s([-1, 100].into_iter()).f32s(&[2.0]);
        let expected = [
            &[0, 1, 0, 0][..],
            &[3, 0, 0, 0, b'a', b'b', 0, 0],
            &1.0_f64.to_le_bytes(),
            &[2, 0, 0, 0, 255, 100, 0, 0],
            &[1, 0, 0, 0],
            &2.0_f32.to_le_bytes(),
        ];
        assert_eq!(message.finish(), expected.concat());
    }
}
