//! The shaders as Rust structs, generated from their SPIR-V by `build.rs`: a field renamed only in
//! GLSL does not compile here.
#![allow(missing_docs)]

use crate::gpu::{Access, Binding, Code, Kind};

include!(concat!(env!("OUT_DIR"), "/shader.rs"));
