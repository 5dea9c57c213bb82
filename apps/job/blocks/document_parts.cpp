#include "apps/job/blocks/document_parts.hpp"

#include <cmath>
#include <tuple>
#include <type_traits>
#include <variant>

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"

namespace orbid::apps {

using Json = nlohmann::ordered_json;

const Job& no_job() {
    static const Job none;
    return none;
}

bool may_be_written(const KeySchema& key, const Json& object) {
    if (key.never_beside && object.contains(*key.never_beside)) return false;
    if (!key.only_with) return true;
    const auto other = object.find(key.only_with->key);
    if (other == object.end()) return !key.only_with->or_key.empty() && object.contains(key.only_with->or_key);
    return key.only_with->values.empty() ||
           (other->is_string() && is_in(other->get<std::string>(), key.only_with->values));
}

std::string path_text(const std::filesystem::path& path, const std::filesystem::path& folder) {
    const auto relative = path.lexically_relative(std::filesystem::absolute(folder).lexically_normal());
    // Empty when the two have no common root.
    return relative.empty() ? path.generic_string() : relative.generic_string();
}

std::string parameter_name(const Job& job, Eigen::Index index) {
    return std::string(job.model.parameter(index).name);
}

std::string coordinate_name(const Job& job, Eigen::Index index) {
    return std::string(job.model.coordinate(index).name);
}

Json parameter_list(const Job& job, const std::vector<Eigen::Index>& indices) {
    return json_list(indices, [&](Eigen::Index index) { return parameter_name(job, index); });
}

Json coordinate_list(const Job& job, const std::vector<Eigen::Index>& indices) {
    return json_list(indices, [&](Eigen::Index index) { return coordinate_name(job, index); });
}

Json columns_document(const Eigen::MatrixXd& matrix) {
    return json_rows(matrix.transpose());
}

Json bounds_document(double lower, double upper) {
    const auto bound = [](double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); };
    return Json::array({bound(lower), bound(upper)});
}

}  // namespace orbid::apps
