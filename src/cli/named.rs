//! Values of options that have names.

use crate::names::Named;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command, Error};
use std::ffi::OsStr;
use std::marker::PhantomData;

/// A parser of named values; help and errors list their names.
#[derive(Clone)]
pub struct NamedParser<E>(PhantomData<E>);

pub fn named<E: Named>() -> NamedParser<E> {
    NamedParser(PhantomData)
}

impl<E: Named> TypedValueParser for NamedParser<E> {
    type Value = E;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, text: &OsStr) -> Result<E, Error> {
        if let Some(Ok(value)) = text.to_str().map(E::named) {
            return Ok(value);
        }
        // It writes the error, with the most similar name.
        let names = PossibleValuesParser::new(E::ALL.iter().map(|value| value.name()));
        let name = names.parse_ref(command, arg, text)?;
        Ok(E::named(&name).expect("a name of the list"))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(E::ALL.iter().map(|value| PossibleValue::new(value.name()))))
    }
}
