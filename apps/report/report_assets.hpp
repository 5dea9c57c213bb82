#pragma once

#include <string_view>

namespace orbid::apps {

/// Parts of a report that are the same in every one, built into the program (apps/report/script/).

/// The style sheet.
[[nodiscard]] std::string_view report_style();
/// The bundled script with the plotting library; empty when the program was built without it
/// (ORBID_REPORT_SCRIPTS=OFF): reports are still ones then.
[[nodiscard]] std::string_view report_script();
/// Name, version and licence texts of the third-party code in the script; empty without it.
[[nodiscard]] std::string_view report_licences();

}  // namespace orbid::apps
