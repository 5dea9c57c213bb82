#include "apps/documents/json_text.hpp"

#include <algorithm>

namespace orbid::apps {
namespace {

constexpr std::size_t line_width = 120;
constexpr std::size_t indent_width = 2;

std::string scalar_text(const nlohmann::ordered_json& value) {
    return value.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

/// On one line, with a space after commas and colons. Gives up (empty) once longer than `longest`.
bool append_on_one_line(const nlohmann::ordered_json& value, std::size_t longest, std::string& out) {
    if (!value.is_structured()) {
        out += scalar_text(value);
        return out.size() <= longest;
    }
    out += value.is_object() ? '{' : '[';
    bool first = true;
    for (auto item = value.begin(); item != value.end(); ++item) {
        if (!first) out += ", ";
        first = false;
        if (value.is_object()) out += scalar_text(item.key()) + ": ";
        if (!append_on_one_line(*item, longest, out)) return false;
    }
    out += value.is_object() ? '}' : ']';
    return out.size() <= longest;
}

bool is_list_of_plain_values(const nlohmann::ordered_json& value) {
    return value.is_array() &&
           std::none_of(value.begin(), value.end(), [](const auto& item) { return item.is_structured(); });
}

/// @param used  characters already on the line.
void append(const nlohmann::ordered_json& value, std::size_t depth, std::size_t used, std::string& out) {
    std::string line;
    const bool unbreakable = !value.is_structured() || value.empty() || is_list_of_plain_values(value);
    if (append_on_one_line(value, unbreakable ? std::string::npos : line_width - std::min(line_width, used), line)) {
        out += line;
        return;
    }
    const std::string indent(indent_width * (depth + 1), ' ');
    out += value.is_object() ? "{\n" : "[\n";
    for (auto item = value.begin(); item != value.end(); ++item) {
        if (item != value.begin()) out += ",\n";
        out += indent;
        std::string key;
        if (value.is_object()) {
            key = scalar_text(item.key()) + ": ";
            out += key;
        }
        append(*item, depth + 1, indent.size() + key.size() + 1, out);
    }
    out += '\n' + std::string(indent_width * depth, ' ');
    out += value.is_object() ? '}' : ']';
}

}  // namespace

std::string json_text(const nlohmann::ordered_json& value) {
    std::string out;
    append(value, 0, 0, out);
    out += '\n';
    return out;
}

nlohmann::ordered_json json_rows(const Eigen::MatrixXd& matrix) {
    auto out = nlohmann::ordered_json::array();
    for (Eigen::Index i = 0; i < matrix.rows(); ++i)
        out.push_back(json_list(matrix.row(i)));
    return out;
}

}  // namespace orbid::apps
