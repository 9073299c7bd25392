//! What to say where no Vulkan device can be used: which drivers are installed, and what to install
//! for this system and its graphics cards.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Variables that name the loader's drivers in place of its folders, the newer one first.
const VARIABLES: [&str; 2] = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"];

/// Folders in which the loader looks for drivers on Linux.
const FOLDERS: [&str; 4] = [
    "/usr/local/etc/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/usr/share/vulkan/icd.d",
];

/// PCI numbers of makers of graphics cards.
const VENDORS: [(&str, &str); 3] = [("0x1002", "AMD"), ("0x8086", "Intel"), ("0x10de", "NVIDIA")];

/// How a family of systems installs things.
struct Packages {
    /// Names in `ID` and `ID_LIKE` of os-release.
    systems: &'static [&'static str],
    install: &'static str,
    loader: &'static str,
    amd: &'static str,
    intel: &'static str,
    /// Draws on the CPU.
    cpu: &'static str,
}

const PACKAGES: [Packages; 5] = [
    Packages {
        systems: &["debian", "ubuntu"],
        install: "apt install",
        loader: "libvulkan1",
        amd: "mesa-vulkan-drivers",
        intel: "mesa-vulkan-drivers",
        cpu: "mesa-vulkan-drivers",
    },
    Packages {
        systems: &["fedora", "rhel", "centos"],
        install: "dnf install",
        loader: "vulkan-loader",
        amd: "mesa-vulkan-drivers",
        intel: "mesa-vulkan-drivers",
        cpu: "mesa-vulkan-drivers",
    },
    Packages {
        systems: &["arch"],
        install: "pacman -S",
        loader: "vulkan-icd-loader",
        amd: "vulkan-radeon",
        intel: "vulkan-intel",
        cpu: "vulkan-swrast",
    },
    Packages {
        systems: &["suse", "opensuse"],
        install: "zypper install",
        loader: "libvulkan1",
        amd: "libvulkan_radeon",
        intel: "libvulkan_intel",
        cpu: "libvulkan_lvp",
    },
    Packages {
        systems: &["alpine"],
        install: "apk add",
        loader: "vulkan-loader",
        amd: "mesa-vulkan-ati",
        intel: "mesa-vulkan-intel",
        cpu: "mesa-vulkan-swrast",
    },
];

/// What is known of a system without opening a device.
#[derive(Clone, Debug, Default)]
struct System {
    /// Text of os-release; empty if there is none.
    os_release: String,
    /// Makers of its graphics cards.
    vendors: BTreeSet<&'static str>,
    /// The variable that names drivers, and the files in it.
    named: Option<(&'static str, Vec<PathBuf>)>,
    /// Drivers in the loader's folders.
    installed: Vec<PathBuf>,
}

/// Says which drivers there are, and what to install.
pub fn advice() -> String {
    let system = System::here();
    format!("{}; {}", system.seen(), system.to_install())
}

/// Says how to install the Vulkan loader and a driver.
pub fn advice_without_loader() -> String {
    let system = System::here();
    let loader = system.packages().map_or("the Vulkan loader".into(), |packages| {
        format!("it by `{} {}`", packages.install, packages.loader)
    });
    format!("install {loader}; {}", system.to_install())
}

impl System {
    fn here() -> System {
        let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_default();
        let inside = |folder: &Path| -> Vec<PathBuf> {
            let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
            let mut paths: Vec<_> = entries.map(|entry| entry.path()).collect();
            paths.sort();
            paths
        };
        let vendors = inside(Path::new("/sys/bus/pci/devices")).into_iter().filter_map(|device| {
            let is_display = read(&device.join("class")).starts_with("0x03");
            let vendor = read(&device.join("vendor"));
            let known = VENDORS.iter().find(|(number, _)| vendor.trim() == *number);
            known.filter(|_| is_display).map(|(_, name)| *name)
        });
        let named = VARIABLES.iter().find_map(|name| {
            let value = std::env::var_os(name).filter(|value| !value.is_empty())?;
            Some((*name, std::env::split_paths(&value).collect()))
        });
        let own = std::env::var_os("XDG_DATA_HOME")
            .map(PathBuf::from)
            .or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".local/share")));
        let folders = own.map(|own| own.join("vulkan/icd.d")).into_iter();
        let folders = folders.chain(FOLDERS.map(PathBuf::from));
        System {
            os_release: read(Path::new("/etc/os-release")),
            vendors: vendors.collect(),
            named,
            installed: folders.flat_map(|folder| inside(&folder)).collect(),
        }
    }

    fn packages(&self) -> Option<&'static Packages> {
        let value = |line: &str| line.split_once('=').map(|(_, names)| names.replace('"', ""));
        let is_name = |line: &&str| line.starts_with("ID=") || line.starts_with("ID_LIKE=");
        let lines = self.os_release.lines().filter(is_name).filter_map(value);
        let names: Vec<String> = lines
            .flat_map(|names| names.split(' ').map(str::to_owned).collect::<Vec<_>>())
            .collect();
        PACKAGES.iter().find(|packages| {
            packages.systems.iter().any(|system| names.iter().any(|name| name.starts_with(system)))
        })
    }

    /// Says which drivers the loader was given.
    fn seen(&self) -> String {
        let (paths, begin) = match &self.named {
            Some((variable, paths)) => (paths, format!("{variable} leaves only the drivers")),
            None => (&self.installed, "the installed drivers are".into()),
        };
        let name = |path: &PathBuf| match path.exists() {
            true => path.display().to_string(),
            false => format!("{}, which does not exist", path.display()),
        };
        match &paths[..] {
            [] => "no driver is installed".into(),
            paths => format!("{begin} {}", paths.iter().map(name).collect::<Vec<_>>().join(", ")),
        }
    }

    /// Says how to get a driver of each graphics card, and one that draws on the CPU.
    fn to_install(&self) -> String {
        let Some(packages) = self.packages() else {
            return "install the driver of your graphics card, or Mesa's lavapipe, which draws on \
                    the CPU"
                .into();
        };
        let by = |package| format!("`{} {package}`", packages.install);
        let for_card = |vendor: &&str| match *vendor {
            "AMD" => format!("{} for the AMD card", by(packages.amd)),
            "Intel" => format!("{} for the Intel card", by(packages.intel)),
            vendor => format!("{vendor}'s driver with its part for Vulkan"),
        };
        let mut ways: Vec<String> = self.vendors.iter().map(for_card).collect();
        ways.push(format!("{} to draw on the CPU", by(packages.cpu)));
        format!("a driver comes by {}", ways.join(", or "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_names_packages_of_the_system_and_its_cards() {
        let system = |release: &str, vendors: &[&'static str]| System {
            os_release: release.into(),
            vendors: vendors.iter().copied().collect(),
            ..System::default()
        };
        assert_eq!(
            system("NAME=\"Linux Mint\"\nID=linuxmint\nID_LIKE=\"ubuntu debian\"\n", &["AMD"])
                .to_install(),
            "a driver comes by `apt install mesa-vulkan-drivers` for the AMD card, or \
             `apt install mesa-vulkan-drivers` to draw on the CPU"
        );
        assert_eq!(
            system("ID=arch\n", &["Intel", "NVIDIA"]).to_install(),
            "a driver comes by `pacman -S vulkan-intel` for the Intel card, or NVIDIA's driver \
             with its part for Vulkan, or `pacman -S vulkan-swrast` to draw on the CPU"
        );
        assert_eq!(
            system("ID=\"opensuse-leap\"\nID_LIKE=\"suse opensuse\"\n", &[]).to_install(),
            "a driver comes by `zypper install libvulkan_lvp` to draw on the CPU"
        );
        assert!(system("", &["AMD"]).to_install().contains("lavapipe"));
    }

    #[test]
    fn drivers_that_were_seen_are_named() {
        let (here, gone) = (std::env::current_exe().unwrap(), PathBuf::from("/nowhere/a.json"));
        let system = System { installed: vec![here.clone()], ..System::default() };
        assert_eq!(system.seen(), format!("the installed drivers are {}", here.display()));
        assert_eq!(System::default().seen(), "no driver is installed");
        let named = Some(("VK_DRIVER_FILES", vec![gone]));
        assert_eq!(
            System { named, ..system }.seen(),
            "VK_DRIVER_FILES leaves only the drivers /nowhere/a.json, which does not exist"
        );
    }
}
