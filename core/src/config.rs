//! Configuration with one home per number: its default, bounds, unit and source stand where the field is declared.
//!
//! [`config!`](crate::config!) declares a section as a plain `Copy` struct with `Default`, serde (unknown keys refused), a
//! [`validate`](Section::validate) that is called once at the rim, and a listing of its fields, documentation
//! included, from which the host prints a commented file, and a [fingerprint](Layout) of its names and types.

use core::fmt::{self, Write};

/// A field's value out of its bounds.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} is {value}, expected {expected}")]
pub struct ConfigError {
    /// Name of the field.
    pub field: &'static str,
    /// What it was.
    pub value: heapless::String<24>,
    /// What would be right.
    pub expected: heapless::String<48>,
}

/// One field of a section, as listed for people.
pub struct Field<'a> {
    /// Key in the file.
    pub name: &'static str,
    /// Documentation, a line each.
    pub doc: &'static [&'static str],
    /// Its value now.
    pub value: &'a dyn ConfigValue,
    /// Bounds or choices, in words; empty if any value will do.
    pub expected: heapless::String<96>,
}

/// A group of fields: one `[table]` of the configuration file.
pub trait Section {
    /// What the section is about, a line each.
    fn doc(&self) -> &'static [&'static str];

    /// Calls `visit` with every field in order.
    fn visit(&self, visit: &mut dyn FnMut(&Field<'_>));

    /// Name of the first field that is out of its bounds (NaN always is), without the words that would cost a small robot 20 KB.
    fn out_of_bounds(&self) -> Option<&'static str>;

    /// # Errors
    /// The first field out of its bounds.
    fn validate(&self) -> Result<(), ConfigError> {
        let Some(field) = self.out_of_bounds() else { return Ok(()) };
        let mut error = ConfigError { field, value: heapless::String::new(), expected: heapless::String::new() };
        self.visit(&mut |listed| {
            if listed.name == field {
                // A text that does not fit is left out: values and bounds are short by construction.
                let _ = listed.value.write_toml(&mut error.value);
                let _ = error.expected.push_str(&listed.expected);
            }
        });
        Err(error)
    }
}

/// A type whose place in bytes has a fingerprint: two programs read one another's bytes if it is the same in both.
///
/// It covers names and types in their order, and the variants of choices; not values, bounds and documentation.
pub trait Layout {
    /// See the trait.
    const LAYOUT: u32;
}

/// The fingerprint of nothing.
pub const NO_LAYOUT: u32 = 0x811C_9DC5;
const FNV_PRIME: u32 = 0x0100_0193;

/// The fingerprint of what has `layout`, and behind it a part called `name`.
///
/// FNV-1a, 32 bits (Fowler, Noll, Vo), of the name and of a zero byte; at compile time, so that it costs no flash.
pub const fn layout_with(layout: u32, name: &str) -> u32 {
    let (mut hash, mut rest) = (layout, name.as_bytes());
    while let [byte, after @ ..] = rest {
        hash = (hash ^ *byte as u32).wrapping_mul(FNV_PRIME);
        rest = after;
    }
    hash.wrapping_mul(FNV_PRIME)
}

/// The same for a part called `name` that has a layout of its own.
pub const fn layout_with_part(layout: u32, name: &str, part: u32) -> u32 {
    let hash = layout_with(layout, name);
    (hash ^ part).wrapping_mul(FNV_PRIME)
}

/// A type that a field may have.
pub trait ConfigValue {
    /// Writes the value as TOML has it.
    ///
    /// # Errors
    /// Only if `out` fails.
    fn write_toml(&self, out: &mut dyn Write) -> fmt::Result;

    /// The values a field of this type may have, in words; empty if the type does not limit them.
    fn choices(&self) -> &'static str {
        ""
    }
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl ConfigValue for $number {
            fn write_toml(&self, out: &mut dyn Write) -> fmt::Result {
                write!(out, "{self:?}")
            }
        }

        impl Layout for $number {
            const LAYOUT: u32 = layout_with(NO_LAYOUT, stringify!($number));
        }
    )*};
}
numbers!(u8, u16, u32, u64, f32, bool);

/// `words` as a fixed-capacity text; empty if too long.
pub fn text(words: &str) -> heapless::String<96> {
    heapless::String::try_from(words).unwrap_or_default()
}

/// Text of bounds: `4 to 512`; the first argument only lends its type to literals.
pub fn describe_bounds<T: ConfigValue>(_typed: &T, bounds: &core::ops::RangeInclusive<T>) -> heapless::String<96> {
    let mut text = heapless::String::new();
    let written = bounds.start().write_toml(&mut text).and_then(|()| text.write_str(" to "));
    // A text that does not fit is cut: bounds are short by construction.
    let _ = written.and_then(|()| bounds.end().write_toml(&mut text));
    text
}

/// Declares a configuration section; see the [module](mod@crate::config).
///
/// A field reads `name: type = default, in low..=high;`, the bounds being optional.
#[macro_export]
macro_rules! config {
    (
        $(#[doc = $section_doc:literal])*
        pub struct $name:ident {
            $(
                $(#[doc = $doc:literal])*
                $field:ident : $type:ty = $default:expr $(, in $bounds:expr)? ;
            )*
        }
    ) => {
        $(#[doc = $section_doc])*
        #[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $( $(#[doc = $doc])* pub $field: $type, )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $field: $default, )* }
            }
        }

        impl $crate::config::Layout for $name {
            const LAYOUT: u32 = {
                let layout = $crate::config::NO_LAYOUT;
                $(
                    let part = <$type as $crate::config::Layout>::LAYOUT;
                    let layout = $crate::config::layout_with_part(layout, stringify!($field), part);
                )*
                layout
            };
        }

        impl $crate::config::Section for $name {
            fn doc(&self) -> &'static [&'static str] {
                &[$($section_doc),*]
            }

            fn visit(&self, visit: &mut dyn FnMut(&$crate::config::Field<'_>)) {
                $(
                    #[allow(unused_mut, unused_assignments)]
                    let mut expected = $crate::config::text(
                        $crate::config::ConfigValue::choices(&self.$field)
                    );
                    $( expected = $crate::config::describe_bounds(&self.$field, &($bounds)); )?
                    visit(&$crate::config::Field {
                        name: stringify!($field),
                        doc: &[$($doc),*],
                        value: &self.$field,
                        expected,
                    });
                )*
            }

            fn out_of_bounds(&self) -> Option<&'static str> {
                $( $( if !($bounds).contains(&self.$field) { return Some(stringify!($field)); } )? )*
                None
            }
        }
    };
}

/// Declares an enumeration that a configuration field can hold, written in the file as the given text.
#[macro_export]
macro_rules! config_choice {
    (
        $(#[doc = $enum_doc:literal])*
        pub enum $name:ident {
            $( $(#[doc = $doc:literal])* $variant:ident = $text:literal, )*
        }
        choices $choices:literal
    ) => {
        $(#[doc = $enum_doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $name {
            $( $(#[doc = $doc])* #[serde(rename = $text)] $variant, )*
        }

        impl $crate::config::ConfigValue for $name {
            fn write_toml(&self, out: &mut dyn core::fmt::Write) -> core::fmt::Result {
                let text = match self { $( Self::$variant => $text, )* };
                write!(out, "\"{text}\"")
            }

            fn choices(&self) -> &'static str {
                $choices
            }
        }

        impl $crate::config::Layout for $name {
            const LAYOUT: u32 = {
                let layout = $crate::config::NO_LAYOUT;
                $( let layout = $crate::config::layout_with(layout, $text); )*
                layout
            };
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    config_choice! {
        /// A choice.
        pub enum Colour {
            /// One.
            Red = "red",
            /// Other.
            Blue = "blue",
        }
        choices "\"red\" or \"blue\""
    }

    config! {
        /// An example.
        pub struct Example {
            /// How many.
            count: u16 = 100, in 4..=512;
            /// How long, m.
            length_m: f32 = 0.3, in 0.01..=10.0;
            /// Which.
            colour: Colour = Colour::Red;
        }
    }

    #[test]
    fn fields_print_as_toml_with_their_bounds() {
        let mut text = heapless::String::<256>::new();
        Example::default().visit(&mut |field| {
            write!(text, "{} = ", field.name).unwrap();
            field.value.write_toml(&mut text).unwrap();
            writeln!(text, " # {}", field.expected).unwrap();
        });
        assert_eq!(
            text,
            "count = 100 # 4 to 512\nlength_m = 0.3 # 0.01 to 10.0\ncolour = \"red\" # \"red\" or \"blue\"\n"
        );
    }

    /// The same fields in other words.
    mod other {
        macro_rules! variant {
            ($module:ident: $first:ident: $type:ty = $default:expr, $second:ident) => {
                pub mod $module {
                    crate::config! {
                        /// Other words.
                        pub struct Example {
                            /// Other words.
                            $first: $type = $default;
                            /// Other words.
                            $second: f32 = 0.5, in 0.2..=1.0;
                            /// Other words.
                            colour: super::super::Colour = super::super::Colour::Blue;
                        }
                    }
                }
            };
        }
        variant!(same: count: u16 = 7, length_m);
        variant!(renamed: number: u16 = 100, length_m);
        variant!(wider: count: u32 = 100, length_m);
        variant!(swapped: length_m: u16 = 100, count);
    }

    #[test]
    fn layout_is_names_types_and_order_and_nothing_else() {
        let layout = Example::LAYOUT;
        assert_eq!(layout, other::same::Example::LAYOUT);
        let others = [
            other::renamed::Example::LAYOUT,
            other::wider::Example::LAYOUT,
            other::swapped::Example::LAYOUT,
            NO_LAYOUT,
        ];
        assert!(!others.contains(&layout), "{layout:x} {others:x?}");
        // The offset basis, and FNV's own test vector "foobar" (BF9CF968) before the zero byte.
        assert_eq!((layout_with(NO_LAYOUT, "foobar"), layout_with(NO_LAYOUT, "")), (0x0C1C_9EB8, 0x050C_5D1F));
    }

    #[test]
    fn value_out_of_bounds_is_named() {
        let error = Example { length_m: f32::NAN, ..Example::default() }.validate().unwrap_err();
        assert_eq!(error.field, "length_m");
        assert_eq!((error.value.as_str(), error.expected.as_str()), ("NaN", "0.01 to 10.0"));
        assert_eq!(Example::default().validate(), Ok(()));
    }
}
