#pragma once

#include <string>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

namespace orbid::apps {

/// JSON text for people and programs: a value that fits on one line stands on one line, longer objects and arrays are
/// broken one level at a time, a list of plain values is never broken. Ends in a newline.
///
/// Numbers are the shortest decimals that read back as the same double; nan and infinities become null.
/// Text that is not UTF-8 is written with replacement characters.
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& value);

/// A matrix as a list of its rows; [] when it has none.
[[nodiscard]] nlohmann::ordered_json json_rows(const Eigen::MatrixXd& matrix);

}  // namespace orbid::apps
