//! Messages as they are, between us and RustDDS: what they mean is not its business.

use std::convert::Infallible;

use rustdds::RepresentationIdentifier;
use rustdds::bytes::Bytes;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};

/// A message in CDR, with its head of four bytes.
#[derive(Debug, Clone)]
pub(crate) struct Raw(pub Vec<u8>);

/// Takes the head off, and puts it on.
pub(crate) struct Whole;

/// See [`Whole`].
#[derive(Debug, Clone)]
pub(crate) struct Head;

impl SerializerAdapter<Raw> for Whole {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &Raw) -> Result<Bytes, Infallible> {
        Ok(Bytes::copy_from_slice(message.0.get(4..).unwrap_or_default()))
    }
}

impl DeserializerAdapter<Raw> for Whole {
    type Error = Infallible;
    type Decoded = Raw;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(decoded: Raw) -> Raw {
        decoded
    }
}

impl Decode<'_, Raw> for Head {
    type Error = Infallible;

    fn decode_bytes(self, body: &[u8], encoding: RepresentationIdentifier) -> Result<Raw, Infallible> {
        let is_little = encoding == RepresentationIdentifier::CDR_LE;
        let head = [0, u8::from(is_little), 0, 0];
        Ok(Raw([&head, body].concat()))
    }
}

impl DefaultDecoder<Raw> for Whole {
    type Decoder = Head;
    const DECODER: Head = Head;
}
