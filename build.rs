//! Compiles GLSL to SPIR-V and generates one typed Rust struct per shader, or per pair of a vertex
//! and a fragment shader of one name; `src/shader.rs` includes the result.
//!
//! Input: every `glsl/*/*.comp|vert|frag` (files in `glsl/lib` are only included). Output:
//! `$OUT_DIR/shader.rs`, and `$OUT_DIR/most.rs`, which says what the largest of them binds
//! (`src/gpu/requirements.rs`). All of it is reflected from the SPIR-V. Bindings become fields with
//! their GLSL names, `&` for `readonly` and `&mut` otherwise. Push constants and structs in buffers
//! become `#[repr(C)]` structs; a padding hole fails the build, because two layouts would have to
//! be kept equal by hand. Specialisation constants become a `Spec`.

use spirq::prelude::*;
use spirq::ty::{ScalarType, StructType};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

fn main() {
    println!("cargo:rerun-if-changed=glsl");
    println!("cargo:rerun-if-changed=build.rs");
    let in_folder = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).expect("glsl/");
        entries.map(|entry| entry.expect("glsl/").path()).collect()
    };
    let folders =
        in_folder(Path::new("glsl")).into_iter().filter(|folder| !folder.ends_with("lib"));
    let mut sources: Vec<PathBuf> = folders.flat_map(|folder| in_folder(&folder)).collect();
    sources.retain(|source| stage(source).is_some());
    // By name, whatever the folder.
    sources.sort_by_key(|source| source.file_name().map(|name| name.to_os_string()));
    let compiled = compile_all(&sources);
    let (mut rust, mut shared, mut most) = (String::new(), BTreeMap::new(), Most::default());
    for source in &sources {
        // The fragment stage is compiled with its vertex stage.
        let stages = match source.extension().and_then(|extension| extension.to_str()) {
            Some("comp") => vec![reflect(&mut shared, source, &compiled[source])],
            Some("vert") => [source.clone(), source.with_extension("frag")]
                .map(|source| reflect(&mut shared, &source, &compiled[&source]))
                .into(),
            _ => continue,
        };
        stages.iter().for_each(|stage| most.include(stage));
        generate(
            &mut rust,
            source.file_stem().and_then(|stem| stem.to_str()).expect("ascii shader name"),
            &stages,
        );
    }
    for (name, body) in shared {
        writeln!(
            rust,
            "#[repr(C)]\n#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]\npub struct {name} {{ {body} }}"
        )
        .unwrap();
    }
    std::fs::write(out("shader.rs"), rust).expect("write shader.rs");
    let Most { buffers, images } = most;
    let constants = format!(
        "pub const STORAGE_BUFFERS: u32 = {buffers};\npub const STORAGE_IMAGES: u32 = {images};\n"
    );
    std::fs::write(out("most.rs"), constants).expect("write most.rs");
}

/// Most that a stage of any shader binds.
#[derive(Default)]
struct Most {
    buffers: usize,
    /// Storage images and texel buffers, which count as images.
    images: usize,
}

impl Most {
    fn include(&mut self, stage: &Stage) {
        let buffers = stage.bindings.values().filter(|(_, (kind, _))| kind == "Buffer").count();
        let all = stage.bindings.len() + stage.area.iter().len();
        self.buffers = self.buffers.max(buffers);
        self.images = self.images.max(all - buffers);
    }
}

/// Returns where the build keeps a file.
fn out(name: &str) -> PathBuf {
    PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join(name)
}

/// SPIR-V of a stage: as it is reflected, before the optimiser removes what is unused, and as it
/// runs.
struct Compiled {
    plain: Vec<u32>,
    optimised: Vec<u32>,
}

/// Compiles all stages on all processors.
fn compile_all(sources: &[PathBuf]) -> BTreeMap<PathBuf, Compiled> {
    let (next, compiled) = (AtomicUsize::new(0), Mutex::new(BTreeMap::new()));
    let work = || {
        while let Some(source) = sources.get(next.fetch_add(1, Ordering::Relaxed)) {
            let plain = compile(source, shaderc::OptimizationLevel::Zero);
            let optimised = precise(&compile(source, shaderc::OptimizationLevel::Performance));
            compiled.lock().unwrap().insert(source.clone(), Compiled { plain, optimised });
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, |threads| threads.get());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(work);
        }
    });
    compiled.into_inner().unwrap()
}

fn stage(path: &Path) -> Option<shaderc::ShaderKind> {
    Some(match path.extension()?.to_str()? {
        "comp" => shaderc::ShaderKind::Compute,
        "vert" => shaderc::ShaderKind::Vertex,
        "frag" => shaderc::ShaderKind::Fragment,
        _ => return None,
    })
}

/// Compiles a shader with debug names, so that reflection, captures and validation messages name
/// `depth` instead of `%23`.
fn compile(source: &Path, level: shaderc::OptimizationLevel) -> Vec<u32> {
    let text = std::fs::read_to_string(source).expect("read shader");
    let compiler = shaderc::Compiler::new().expect("shaderc");
    let mut options = shaderc::CompileOptions::new().expect("shaderc options");
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(level);
    options.set_generate_debug_info();
    options.set_auto_bind_uniforms(true);
    options.set_warnings_as_errors();
    options.set_include_callback(|name, _, _, _| {
        let path = Path::new("glsl/lib").join(name);
        let content = std::fs::read_to_string(&path)
            .map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(shaderc::ResolvedInclude { resolved_name: path.display().to_string(), content })
    });
    let kind = stage(source).expect("filtered by main");
    match compiler.compile_into_spirv(
        &text,
        kind,
        &source.display().to_string(),
        "main",
        Some(&options),
    ) {
        Ok(artifact) => artifact.as_binary().to_vec(),
        Err(error) => panic!("{error}"),
    }
}

/// Forbids contraction and reordering of every floating-point operation, so that all drivers give
/// the same bits (guide: numerics, case 25). GLSL's `precise` applies to one variable at a time,
/// and the optimiser forgets it wherever it inlines a function a second time.
fn precise(words: &[u32]) -> Vec<u32> {
    // FNegate, FAdd, FSub, FMul, FDiv, FRem, FMod, VectorTimesScalar, Dot.
    const ARITHMETIC: [u32; 9] = [127, 129, 131, 133, 136, 140, 141, 142, 148];
    const OP_DECORATE: u32 = 71;
    const OP_MEMBER_DECORATE: u32 = 72;
    const NO_CONTRACTION: u32 = 42;
    let (mut results, mut decorations_end, mut at) = (Vec::new(), 5, 5);
    while at < words.len() {
        let (op, length) = (words[at] & 0xFFFF, (words[at] >> 16).max(1) as usize);
        if ARITHMETIC.contains(&op) {
            results.push(words[at + 2]);
        }
        at += length;
        if op == OP_DECORATE || op == OP_MEMBER_DECORATE {
            decorations_end = at;
        }
    }
    assert!(decorations_end > 5, "a shader without decorations has no place for more");
    let added = results.into_iter().flat_map(|id| [3 << 16 | OP_DECORATE, id, NO_CONTRACTION]);
    words[..decorations_end]
        .iter()
        .copied()
        .chain(added)
        .chain(words[decorations_end..].iter().copied())
        .collect()
}

/// Reflection of a stage.
struct Stage {
    /// Name of the file with its SPIR-V, beside the generated source.
    code: String,
    /// Name, kind and access by binding.
    bindings: BTreeMap<u32, (String, (String, String))>,
    push: Option<String>,
    /// Name and type by constant id.
    spec: BTreeMap<u32, (String, String)>,
    /// Binding and constant of glsl/lib/tile_mask.glsl, which the graph sets and which are no
    /// fields.
    area: Option<u32>,
    listed: Option<u32>,
    workgroup: [u32; 3],
}

fn reflect(shared: &mut BTreeMap<String, String>, source: &Path, compiled: &Compiled) -> Stage {
    let Compiled { plain, optimised } = compiled;
    let entry = ReflectConfig::new()
        .spv(without_constant_expressions(plain))
        .reflect()
        .unwrap_or_else(|error| panic!("{}: {error}", source.display()))
        .remove(0);
    let code = format!("{}.spv", source.file_name().expect("a file").display());
    let bytes: Vec<u8> = optimised.iter().flat_map(|word| word.to_ne_bytes()).collect();
    std::fs::write(out(&code), bytes).expect("write SPIR-V");
    let workgroup = workgroup(plain);
    let mut stage = Stage {
        code,
        bindings: BTreeMap::new(),
        push: None,
        spec: BTreeMap::new(),
        area: None,
        listed: None,
        workgroup,
    };
    for variable in &entry.vars {
        // Built-in inputs, and the unnamed duplicate of the workgroup-width constant.
        let Some(name) = variable.name().map(str::to_string) else { continue };
        match variable {
            Variable::Descriptor { desc_bind, .. } if name == "area" => {
                stage.area = Some(desc_bind.bind())
            }
            Variable::SpecConstant { spec_id, .. } if name == "LISTED" => {
                stage.listed = Some(*spec_id)
            }
            Variable::Descriptor { desc_bind, desc_ty, ty, .. } => {
                stage.bindings.insert(desc_bind.bind(), (name, binding(source, desc_ty, ty)));
                if let Some(element) = element_struct(ty) {
                    let (name, body) = (
                        element.name().expect("named struct").to_string(),
                        fields(source, element),
                    );
                    assert!(
                        shared.insert(name.clone(), body.clone()).is_none_or(|other| other == body),
                        "{name} differs between shaders"
                    );
                }
            }
            Variable::PushConstant { ty: Type::Struct(members), .. } => {
                stage.push = Some(fields(source, members))
            }
            Variable::SpecConstant { spec_id, ty, .. } => {
                let ty = scalar(ty)
                    .unwrap_or_else(|| panic!("{}: specialisation of {ty}", source.display()));
                stage.spec.insert(*spec_id, (name.to_lowercase(), ty));
            }
            _ => {}
        }
    }
    stage
}

/// Generates the struct of one stage, or of a vertex and a fragment stage that share its fields;
/// set 0 belongs to the former, set 1 to the latter.
fn generate(rust: &mut String, module: &str, stages: &[Stage]) {
    let structure: String =
        module.split('_').map(|part| part[..1].to_uppercase() + &part[1..]).collect();
    let (mut names, mut spec, mut push) = (BTreeSet::new(), BTreeMap::new(), None);
    for stage in stages {
        for (name, _) in stage.bindings.values() {
            assert!(names.insert(name), "{module}: {name} is bound by two stages");
        }
        spec.extend(stage.spec.clone());
        assert!(push.is_none() || stage.push.is_none(), "{module}: two stages have push constants");
        push = push.or(stage.push.as_ref());
    }
    let mut declared = String::new();
    for (name, (kind, access)) in stages.iter().flat_map(|stage| stage.bindings.values()) {
        let handle =
            if kind == "Buffer" || kind.starts_with("Texels") { "Buffer" } else { "Image" };
        let reference = if access == "Read" { "&'a" } else { "&'a mut" };
        writeln!(declared, "    pub {name}: {reference} crate::graph::{handle},").unwrap();
    }
    let push_field = push.map_or(String::new(), |_| format!("    pub push: {module}::Push,\n"));
    let spec_field =
        if spec.is_empty() { String::new() } else { format!("    pub spec: {module}::Spec,\n") };
    let push_bytes =
        push.map_or("&[]".to_string(), |_| "bytemuck::bytes_of(&self.push)".to_string());
    let constant = |(id, (name, ty)): (&u32, &(String, String))| match ty.as_str() {
        "bool" => format!("({id}, self.spec.{name} as u32)"),
        "u32" => format!("({id}, self.spec.{name})"),
        _ => panic!("{module}: specialisation constant {name} is {ty}, neither bool nor uint"),
    };
    let constants = spec.iter().map(constant).collect::<Vec<_>>().join(", ");
    let lifetime = if names.is_empty() { "" } else { "<'a>" };
    let code = |stage: &Stage| {
        let mut table = String::new();
        for (bind, (name, (kind, access))) in &stage.bindings {
            writeln!(table, "Binding {{ name: {name:?}, bind: {bind}, kind: Kind::{kind}, access: Access::{access} }},").unwrap();
        }
        if let Some(bind) = stage.area {
            writeln!(table, "Binding {{ name: \"area\", bind: {bind}, kind: Kind::TexelsR32ui, access: Access::Read }},").unwrap();
        }
        let push_size = stage
            .push
            .as_ref()
            .map_or("0".to_string(), |_| format!("std::mem::size_of::<{module}::Push>() as u32"));
        let Stage { code, workgroup, listed, .. } = stage;
        format!(
            "Code {{ name: {module:?}, spirv: include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{code}\")), bindings: &[{table}], push_bytes: {push_size}, workgroup: {workgroup:?}, listed: {listed:?} }}"
        )
    };
    let uses = |stage: &Stage| {
        let use_of = |(name, (_, access)): &(String, (String, String))| {
            let reborrowed = if access == "Read" { "" } else { "&*" };
            format!("crate::graph::Handle::resource({reborrowed}self.{name})")
        };
        let names = stage.bindings.values().map(use_of).collect::<Vec<_>>().join(", ");
        format!("vec![{names}]")
    };

    writeln!(rust, "/// `glsl/{module}`\npub struct {structure}{lifetime} {{\n{declared}{push_field}{spec_field}}}").unwrap();
    let (shader, codes, resources) = match stages {
        [stage] => (
            "Shader",
            format!("const CODE: Code = {};", code(stage)),
            format!("Vec<crate::graph::ResourceId> {{ {} }}", uses(stage)),
        ),
        [vertex, fragment] => (
            "Raster",
            format!("const STAGES: [Code; 2] = [{}, {}];", code(vertex), code(fragment)),
            format!(
                "[Vec<crate::graph::ResourceId>; 2] {{ [{}, {}] }}",
                uses(vertex),
                uses(fragment)
            ),
        ),
        _ => unreachable!("one stage, or two"),
    };
    writeln!(
        rust,
        "impl{lifetime} crate::graph::{shader} for {structure}{lifetime} {{
            {codes}
            fn resources(&self) -> {resources}
            fn push(&self) -> &[u8] {{ {push_bytes} }}
            fn constants(&self) -> Vec<(u32, u32)> {{ vec![{constants}] }}
        }}"
    )
    .unwrap();
    writeln!(rust, "pub mod {module} {{").unwrap();
    if let Some(body) = push {
        writeln!(
            rust,
            "#[repr(C)]\n#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]\npub struct Push {{ {body} }}"
        )
        .unwrap();
        writeln!(rust, "const _: () = assert!(std::mem::size_of::<Push>() <= 128, \"Vulkan promises 128 bytes of push constants\");")
            .unwrap();
    }
    if !spec.is_empty() {
        let body: String = spec.values().map(|(name, ty)| format!("pub {name}: {ty}, ")).collect();
        writeln!(rust, "#[derive(Clone, Copy, Debug)]\npub struct Spec {{ {body} }}").unwrap();
    }
    writeln!(rust, "}}").unwrap();
}

/// Returns kind and access of a binding: `readonly` reads, `writeonly` overwrites all it is
/// dispatched over, neither modifies.
fn binding(source: &Path, descriptor: &DescriptorType, ty: &Type) -> (String, String) {
    let access = |access: &AccessType| match access {
        AccessType::ReadOnly => "Read",
        AccessType::WriteOnly => "Write",
        AccessType::ReadWrite => "Modify",
    };
    match (descriptor, ty) {
        (DescriptorType::StorageBuffer(a), _) => ("Buffer".into(), access(a).into()),
        (DescriptorType::StorageTexelBuffer(a), Type::StorageImage(image)) => {
            (format!("Texels{:?}", image.fmt), access(a).into())
        }
        (DescriptorType::StorageImage(a), Type::StorageImage(image)) => {
            (format!("{:?}", image.fmt), access(a).into())
        }
        _ => panic!(
            "{}: only storage buffers, texel buffers and storage images are bound, not {ty}",
            source.display()
        ),
    }
}

/// Returns the element struct of a storage buffer.
fn element_struct(ty: &Type) -> Option<&StructType> {
    let Type::Struct(block) = ty else { return None };
    let Type::Array(array) = &block.members.last()?.ty else { return None };
    let Type::Struct(element) = &*array.element_ty else { return None };
    Some(element)
}

/// Writes the Rust fields of a scalar-layout struct; a hole between fields fails the build.
fn fields(source: &Path, structure: &StructType) -> String {
    let (mut body, mut end) = (String::new(), 0);
    for member in &structure.members {
        let name = member.name.as_deref().expect("named member");
        let (ty, bytes) = host_type(&member.ty)
            .unwrap_or_else(|| panic!("{}: {name} has type {}", source.display(), member.ty));
        assert_eq!(member.offset, Some(end), "{}: a padding hole before {name}", source.display());
        write!(body, "pub {name}: {ty}, ").unwrap();
        end += bytes;
    }
    body
}

fn host_type(ty: &Type) -> Option<(String, usize)> {
    Some(match ty {
        Type::Scalar(_) => (scalar(ty)?, 4),
        Type::Vector(vector) => (
            format!("[{}; {}]", scalar(&Type::Scalar(vector.scalar_ty.clone()))?, vector.nscalar),
            4 * vector.nscalar as usize,
        ),
        Type::Array(array) => {
            let (element, bytes) = host_type(&array.element_ty)?;
            (format!("[{element}; {}]", array.nelement?), bytes * array.nelement? as usize)
        }
        _ => return None,
    })
}

fn scalar(ty: &Type) -> Option<String> {
    let Type::Scalar(scalar) = ty else { return None };
    Some(
        match scalar {
            ScalarType::Integer { bits: 32, is_signed: true } => "i32",
            ScalarType::Integer { bits: 32, is_signed: false } => "u32",
            ScalarType::Float { bits: 32 } => "f32",
            ScalarType::Boolean => "bool",
            _ => return None,
        }
        .to_string(),
    )
}

/// Removes `OpSpecConstantOp` for reflection: spirq knows few of its operations, and nothing it
/// reports depends on them.
fn without_constant_expressions(words: &[u32]) -> Vec<u32> {
    const OP_SPEC_CONSTANT_OP: u32 = 52;
    let mut kept = words[..5].to_vec();
    let mut at = 5;
    while at < words.len() {
        let end = at + ((words[at] >> 16) as usize).max(1);
        if words[at] & 0xFFFF != OP_SPEC_CONSTANT_OP {
            kept.extend_from_slice(&words[at..end]);
        }
        at = end;
    }
    kept
}

/// Returns the literal workgroup size (`OpExecutionMode LocalSize`); `[0, 0, 0]` if specialisation
/// constants set it.
fn workgroup(words: &[u32]) -> [u32; 3] {
    const OP_EXECUTION_MODE: u32 = 16;
    const LOCAL_SIZE: u32 = 17;
    let mut at = 5;
    while at < words.len() {
        let (op, length) = (words[at] & 0xFFFF, (words[at] >> 16) as usize);
        if op == OP_EXECUTION_MODE && words[at + 2] == LOCAL_SIZE {
            return [words[at + 3], words[at + 4], words[at + 5]];
        }
        at += length.max(1);
    }
    [0; 3]
}
