use crate::error::Result;
use crate::progress::Progress;
#[derive(clap::Args, Clone, Debug)]
pub struct Arguments {}
pub fn run(_arguments: &Arguments, _progress: &dyn Progress) -> Result<()> { Ok(()) }
