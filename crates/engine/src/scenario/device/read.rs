//! Reading of a device's settings from a file; only the kind of the device knows their type.

use core::fmt;
use core::marker::PhantomData;
use std::collections::BTreeMap;

use serde::de::{
    Deserialize, DeserializeSeed, Deserializer, EnumAccess, Error, IgnoredAny, VariantAccess,
    Visitor,
};
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::{DeviceKind, DeviceSpec, kind, kinds};

/// Takes the devices from a file. Each keeps its position in the file, for messages.
pub(in super::super) fn read_devices(
    document: &mut DeTable<'_>,
) -> Result<BTreeMap<String, DeviceSpec>, toml::de::Error> {
    let Some(devices) = document.remove("device") else {
        return Ok(BTreeMap::new());
    };
    // A value that is not a table is rejected by the reader of the map.
    if !matches!(devices.get_ref(), DeValue::Table(_)) {
        return BTreeMap::deserialize(ValueDeserializer::from(devices));
    }
    let DeValue::Table(devices) = devices.into_inner() else {
        return Ok(BTreeMap::new());
    };
    let read = |(name, device): (Spanned<_>, Spanned<DeValue<'_>>)| {
        let name: std::borrow::Cow<'_, str> = name.into_inner();
        Ok((name.into_owned(), read_device(device)?))
    };
    devices.into_iter().map(read).collect()
}

fn read_device(device: Spanned<DeValue<'_>>) -> Result<DeviceSpec, toml::de::Error> {
    let found = ValueDeserializer::from(device.clone());
    let UnreadSettings { kind, .. } = UnreadSettings::<IgnoredAny>::deserialize(found)?;
    let settings = match device.into_inner() {
        DeValue::Table(mut table) => table.remove(kind.name()),
        _ => None,
    };
    let nothing = || Spanned::new(0..0, DeValue::Table(DeTable::new()));
    let settings = kind.parse(ValueDeserializer::from(settings.unwrap_or_else(nothing)))?;
    Ok(DeviceSpec { kind, settings })
}

impl<'de> Deserialize<'de> for DeviceSpec {
    /// Settings read here would store a wrong position in the file; only
    /// [`Scenario::parse`](crate::scenario::Scenario::parse) knows the right one.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let UnreadSettings { kind, settings } =
            UnreadSettings::<toml::Value>::deserialize(deserializer)?;
        // A file is a table; settings need not be one.
        let file = toml::Table::from_iter([(SETTINGS.to_owned(), settings)]);
        let text = toml::to_string(&file).map_err(D::Error::custom)?;
        let table = DeTable::parse(&text).map_err(|error| D::Error::custom(error.message()))?;
        let settings = table.into_inner().remove(SETTINGS);
        let settings = settings.ok_or_else(|| D::Error::missing_field(SETTINGS))?;
        let settings = kind
            .parse(ValueDeserializer::from(settings))
            .map_err(|error| D::Error::custom(error.message()))?;
        Ok(Self { kind, settings })
    }
}

/// Name of the only key of a file of settings.
const SETTINGS: &str = "settings";

/// A kind and its unparsed settings.
struct UnreadSettings<T> {
    kind: &'static dyn DeviceKind,
    settings: T,
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for UnreadSettings<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_enum("DeviceSpec", &[], SettingsVisitor(PhantomData))
    }
}

struct SettingsVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for SettingsVisitor<T> {
    type Value = UnreadSettings<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("enum DeviceSpec")
    }

    fn visit_enum<A: EnumAccess<'de>>(self, data: A) -> Result<UnreadSettings<T>, A::Error> {
        let (kind, variant) = data.variant_seed(KindSeed)?;
        let settings = variant.newtype_variant()?;
        Ok(UnreadSettings { kind, settings })
    }
}

/// Names of the kinds that exist only with the feature `programs`.
const OF_PROGRAMS: [&str; 2] = ["program", "firmware"];

/// Finds the kind of a name.
struct KindSeed;

impl<'de> DeserializeSeed<'de> for KindSeed {
    type Value = &'static dyn DeviceKind;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

impl Visitor<'_> for KindSeed {
    type Value = &'static dyn DeviceKind;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("variant identifier")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        kind(name).ok_or_else(|| {
            if OF_PROGRAMS.contains(&name) {
                return E::custom(format!(
                    "\"{name}\" needs the feature \"programs\" of the crate hilrig, which is not enabled"
                ));
            }
            let known: Vec<String> = kinds()
                .iter()
                .map(|kind| format!("`{}`", kind.name()))
                .collect();
            let known = known.join(", ");
            E::custom(format!("unknown variant `{name}`, expected one of {known}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::Path;

    use super::DeviceSpec;
    use crate::scenario::{Scenario, Xv11Spec};

    fn parse(device: &str) -> Result<Scenario, String> {
        let text = format!(
            "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"1s\"\n{device}\n\
            [world]\nstart = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n"
        );
        let parsed = Scenario::parse(Path::new("t.toml"), text);
        parsed
            .map(|(scenario, _)| scenario)
            .map_err(|error| error.to_string())
    }

    /// The texts are those of a derived enum of all kinds.
    #[test]
    fn what_is_wrong_with_a_device_is_shown_in_its_line() {
        let wrong = |device| parse(device).expect_err("wrong");
        let unknown = wrong("[device.lidar.xv12]");
        assert!(
            unknown.starts_with("t.toml:5: device.lidar.xv12: is \"xv12\", did you mean \"xv11\"?"),
            "{unknown}"
        );
        let misspelt = wrong("[device.lidar.xv11]\nprofil = \"a\"");
        assert!(
            misspelt.starts_with("t.toml:6: device.lidar.xv11.profil: is an unknown key"),
            "{misspelt}"
        );
        insta::assert_snapshot!(wrong("[device.lidar.xv11]\nindex0_deg = \"a\""), @r#"t.toml:6: device.lidar.xv11.index0_deg: is "a", expected a number"#);
        let no_kind = wrong("[device.lidar]");
        assert!(
            no_kind.starts_with(
                "t.toml:5: device.lidar: is a table without a key, expected one of xv11, "
            ),
            "{no_kind}"
        );
        let number = wrong("[device]\nlidar = 3");
        assert!(
            number.starts_with("t.toml:6: device.lidar: is 3, expected one of xv11, "),
            "{number}"
        );
        insta::assert_snapshot!(wrong("[device.lidar]\nxv11 = 3"), @r#"t.toml:6: device.lidar.xv11: is 3, expected a table"#);
        insta::assert_snapshot!(wrong("device = 3"), @r#"t.toml:5: device: is 3, expected a table"#);
    }

    /// A number keeps its position in the list of keys; a position in the file is not a part of the
    /// number.
    #[test]
    fn settings_are_written_as_they_were_read() {
        let keys = "[device.lidar.xv11]\nprofile = \"fw2.1\"\nindex0_deg = -10.0\n\
            faults = [\"dust\"]\n\n[device.lidar.xv11.mount]\nx_m = 0.05\ny_m = 0.0\n\
            heading_deg = 30.0\n";
        let scenario = parse(keys).expect("sound");
        let text = scenario.to_toml();
        assert!(text.contains(keys.trim_end()), "{text}");
        let again = Scenario::parse(Path::new("again.toml"), text)
            .expect("sound")
            .0;
        assert_eq!(again, scenario);
        let spec: &Xv11Spec = again.device["lidar"].settings().expect("an XV-11");
        assert_eq!(spec.mount.map(|mount| mount.heading_deg), Some(30.0));
        let plain: Scenario = toml::from_str(&scenario.to_toml()).expect("sound");
        assert_eq!(plain, scenario);
    }

    /// Within a saved case, another reader parses the settings; they need not be a table.
    #[test]
    fn settings_that_are_no_table_are_read_within_a_case() {
        #[derive(serde::Deserialize)]
        struct File {
            device: BTreeMap<String, DeviceSpec>,
        }
        let text = "[device.meter]\ndescription = \"modbus-meter\"\n[device.head]\nxv11 = {}\n";
        let file: File = toml::from_str(text).expect("settings");
        let kinds = file.device.values().map(DeviceSpec::kind);
        assert_eq!(kinds.collect::<Vec<_>>(), ["xv11", "description"]);
    }
}
