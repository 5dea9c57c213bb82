#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

// What several blocks write alike.

[[nodiscard]] std::string path_text(const std::filesystem::path& path, const std::filesystem::path& folder);
[[nodiscard]] std::string parameter_name(const Job& job, Eigen::Index index);
[[nodiscard]] std::string coordinate_name(const Job& job, Eigen::Index index);
/// Names of several.
[[nodiscard]] nlohmann::ordered_json parameter_list(const Job& job, const std::vector<Eigen::Index>& indices);
[[nodiscard]] nlohmann::ordered_json coordinate_list(const Job& job, const std::vector<Eigen::Index>& indices);
/// The columns of a matrix, each a list.
[[nodiscard]] nlohmann::ordered_json columns_document(const Eigen::MatrixXd& matrix);
/// [lower, upper], null where infinite.
[[nodiscard]] nlohmann::ordered_json bounds_document(double lower, double upper);
/// The name of a value of an enumeration.
template <class Enum>
[[nodiscard]] const std::string& name_of(Enum value, const std::vector<std::string>& names) {
    return names[static_cast<std::size_t>(value)];
}

}  // namespace orbid::apps
