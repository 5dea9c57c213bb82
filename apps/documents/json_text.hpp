#pragma once

#include <string>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

namespace orbid::apps {

/// JSON text for people and programs. A value that fits on one line takes one line. Longer objects and arrays are
/// broken one level at a time, but never a list of plain values. Ends in a newline.
///
/// Numbers are the shortest decimals that read back as the same double; nan and infinities become null.
/// Text that is not UTF-8 is written with replacement characters.
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& value);

/// A matrix as a list of its rows; [] when it has none.
[[nodiscard]] nlohmann::ordered_json json_rows(const Eigen::MatrixXd& matrix);

}  // namespace orbid::apps
