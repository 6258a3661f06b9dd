//! The sections around the entities: what the release asks of every file.

use super::Dxf;

/// Name of the application of extended data.
pub(super) const APPLICATION: &str = "INSULA";
/// Stands for the handle after the last one until it is known.
pub(super) const HANDSEED: &str = "$SEED";
/// Units of the header: `$INSUNITS`.
const MILLIMETRES: i64 = 4;
const METRES: i64 = 6;
/// Handles of blocks and dictionaries, which others refer to.
pub(super) const MODEL_SPACE: u32 = 0x1;
const PAPER_SPACE: u32 = 0x2;
const ROOT: u32 = 0x3;
const GROUPS: u32 = 0x4;
/// Of everything else.
pub(super) const FIRST_HANDLE: u32 = 0x10;

impl Dxf<'_> {
    pub(super) fn header(&mut self) {
        let is_metric = self.drawing.metres.is_some();
        self.begin_section("HEADER");
        self.group(9, "$ACADVER");
        self.group(1, "AC1015");
        self.group(9, "$DWGCODEPAGE");
        self.group(3, "ANSI_1252");
        self.group(9, "$HANDSEED");
        self.group(5, HANDSEED);
        self.group(9, "$INSUNITS");
        self.integer(70, if is_metric { METRES } else { MILLIMETRES });
        self.group(9, "$MEASUREMENT");
        self.integer(70, 1);
        self.group(0, "ENDSEC");
    }

    pub(super) fn tables(&mut self, content: &Self) {
        self.begin_section("TABLES");
        self.viewport(content.extent);
        let owner = self.begin_table("LTYPE", 3);
        for name in ["ByBlock", "ByLayer", "Continuous"] {
            self.entry("LTYPE", owner, "AcDbLinetypeTableRecord", name);
            for (code, value) in [(70, "0"), (3, ""), (72, "65"), (73, "0"), (40, "0")] {
                self.group(code, value);
            }
        }
        self.group(0, "ENDTAB");
        let mut layers = content.layers.clone();
        layers.insert("0".to_owned(), 7);
        let owner = self.begin_table("LAYER", layers.len());
        for (name, color) in layers {
            self.entry("LAYER", owner, "AcDbLayerTableRecord", &name);
            self.integer(70, 0);
            self.integer(62, i64::from(color));
            self.group(6, "Continuous");
        }
        self.group(0, "ENDTAB");
        let owner = self.begin_table("STYLE", 1);
        self.entry("STYLE", owner, "AcDbTextStyleTableRecord", "Standard");
        for (code, value) in [(70, "0"), (40, "0"), (41, "1"), (50, "0"), (71, "0"), (42, "2.5"), (3, "txt"), (4, "")] {
            self.group(code, value);
        }
        self.group(0, "ENDTAB");
        for name in ["VIEW", "UCS"] {
            self.begin_table(name, 0);
            self.group(0, "ENDTAB");
        }
        let owner = self.begin_table("APPID", 2);
        for name in ["ACAD", APPLICATION] {
            self.entry("APPID", owner, "AcDbRegAppTableRecord", name);
            self.integer(70, 0);
        }
        self.group(0, "ENDTAB");
        self.dimension_styles();
        let owner = self.begin_table("BLOCK_RECORD", 2);
        for (handle, name) in [(MODEL_SPACE, "*Model_Space"), (PAPER_SPACE, "*Paper_Space")] {
            self.entry_of("BLOCK_RECORD", (5, handle), owner, "AcDbBlockTableRecord", name);
        }
        self.group(0, "ENDTAB");
        self.group(0, "ENDSEC");
    }

    /// Programs open the file with all of the drawing in their window.
    fn viewport(&mut self, [min, max]: [[f64; 2]; 2]) {
        let owner = self.begin_table("VPORT", 1);
        self.entry("VPORT", owner, "AcDbViewportTableRecord", "*Active");
        self.integer(70, 0);
        let size = [0, 1].map(|k| (max[k] - min[k]).max(0.0));
        let middle = [0, 1].map(|k| if size[k].is_finite() { 0.5 * (min[k] + max[k]) } else { 0.0 });
        let height = size[1].max(0.5 * size[0]).clamp(1.0, 1e9);
        for (code, value) in [
            (10, 0.0),
            (20, 0.0),
            (11, 1.0),
            (21, 1.0),
            (12, middle[0]),
            (22, middle[1]),
            (16, 0.0),
            (26, 0.0),
            (36, 1.0),
            (17, 0.0),
            (27, 0.0),
            (37, 0.0),
            (40, 1.1 * height),
            (41, 2.0),
        ] {
            self.number(code, value);
        }
        self.group(0, "ENDTAB");
    }

    fn dimension_styles(&mut self) {
        let owner = self.begin_table("DIMSTYLE", 1);
        self.group(100, "AcDbDimStyleTable");
        let handle = self.new_handle();
        self.entry_of("DIMSTYLE", (105, handle), owner, "AcDbDimStyleTableRecord", "Standard");
        self.integer(70, 0);
        self.group(0, "ENDTAB");
    }

    /// Returns its handle.
    fn begin_table(&mut self, name: &str, entries: usize) -> u32 {
        let handle = self.new_handle();
        self.group(0, "TABLE");
        self.group(2, name);
        self.handle(5, handle);
        self.handle(330, 0);
        self.group(100, "AcDbSymbolTable");
        self.integer(70, entries as i64);
        handle
    }

    fn entry(&mut self, kind: &str, owner: u32, class: &str, name: &str) {
        let handle = self.new_handle();
        self.entry_of(kind, (5, handle), owner, class, name);
    }

    fn entry_of(&mut self, kind: &str, (code, handle): (u32, u32), owner: u32, class: &str, name: &str) {
        self.group(0, kind);
        self.handle(code, handle);
        self.handle(330, owner);
        self.group(100, "AcDbSymbolTableRecord");
        self.group(100, class);
        self.group(2, name);
    }

    pub(super) fn blocks(&mut self) {
        self.begin_section("BLOCKS");
        for (record, name) in [(MODEL_SPACE, "*Model_Space"), (PAPER_SPACE, "*Paper_Space")] {
            for (kind, class) in [("BLOCK", "AcDbBlockBegin"), ("ENDBLK", "AcDbBlockEnd")] {
                let handle = self.new_handle();
                self.group(0, kind);
                self.handle(5, handle);
                self.handle(330, record);
                self.group(100, "AcDbEntity");
                self.group(8, "0");
                self.group(100, class);
                if kind == "BLOCK" {
                    self.group(2, name);
                    self.integer(70, 0);
                    [10, 20, 30].into_iter().for_each(|code| self.integer(code, 0));
                    self.group(3, name);
                    self.group(1, "");
                }
            }
        }
        self.group(0, "ENDSEC");
    }

    /// The dictionaries that the release asks for.
    pub(super) fn objects(&mut self) {
        self.begin_section("OBJECTS");
        for (handle, owner, entry) in [(ROOT, 0, Some(GROUPS)), (GROUPS, ROOT, None)] {
            self.group(0, "DICTIONARY");
            self.handle(5, handle);
            self.handle(330, owner);
            self.group(100, "AcDbDictionary");
            self.integer(281, 1);
            if let Some(entry) = entry {
                self.group(3, "ACAD_GROUP");
                self.handle(350, entry);
            }
        }
        self.group(0, "ENDSEC");
    }
}
