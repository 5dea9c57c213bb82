#pragma once

#include <functional>
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

/// A list with `entry(x)` for every x of a range.
template <class Range, class Entry = std::identity>
[[nodiscard]] nlohmann::ordered_json json_list(const Range& range, Entry entry = {}) {
    auto out = nlohmann::ordered_json::array();
    for (const auto& x : range)
        out.push_back(nlohmann::ordered_json(std::invoke(entry, x)));
    return out;
}

/// null for what is empty: a text, a list, an optional value that is not there.
template <class Value>
[[nodiscard]] nlohmann::ordered_json json_or_null(const Value& value) {
    if constexpr (requires { value.has_value(); }) {
        return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
    } else {
        return value.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(value);
    }
}

/// A matrix as a list of its rows; [] when it has none.
[[nodiscard]] nlohmann::ordered_json json_rows(const Eigen::MatrixXd& matrix);

}  // namespace orbid::apps
