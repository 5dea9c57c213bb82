#include <algorithm>

#include "apps/job/data_job.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

std::vector<std::string> parameter_names(const Job& job) {
    return job.model.system ? names_of(job.model.system->parameters()) : std::vector<std::string>{};
}

std::vector<std::string> coordinate_names(const Job& job) {
    return job.model.system ? names_of(job.model.system->coordinates()) : std::vector<std::string>{};
}

std::optional<Eigen::Index> parameter_named(const std::string& name, const ValueReader& at, const Job& job) {
    if (!job.model.system) return std::nullopt;
    const Eigen::Index index = job.model.system->parameter_index(name);
    if (index >= 0) return index;
    at.report(fmt::format("the model {} has no parameter \"{}\"{}", job.model.name, name,
                          suggestion(name, parameter_names(job))));
    return std::nullopt;
}

std::optional<Eigen::Index> coordinate_named(const std::string& name, const ValueReader& at, const Job& job) {
    if (!job.model.system) return std::nullopt;
    const Eigen::Index index = job.model.system->coordinate_index(name);
    if (index >= 0) return index;
    at.report(fmt::format("the model {} has no coordinate \"{}\"{}", job.model.name, name,
                          suggestion(name, coordinate_names(job))));
    return std::nullopt;
}

std::vector<std::pair<std::string, ValueReader>> read_names(const ValueReader& value) {
    std::vector<std::pair<std::string, ValueReader>> result;
    for (const ValueReader& item : value.items())
        if (const auto name = item.text()) result.emplace_back(*name, item);
    return result;
}

std::vector<std::size_t> experiments_with(const Job& job, orbits::Series::Sampling sampling) {
    std::vector<std::size_t> experiments;
    for (std::size_t i = 0; i < job.data.size(); ++i)
        if (job.data[i].sampling() == sampling) experiments.push_back(i);
    return experiments;
}

std::vector<std::size_t> read_experiments(const ValueReader& value, const Job& job,
                                          const std::function<void(const ValueReader&, const DataJob&)>& check) {
    std::vector<std::string> known;
    for (const DataJob& data : job.data)
        known.push_back(data.name);
    std::vector<std::size_t> experiments;
    for (const auto& [name, item] : read_names(value)) {
        const auto at = std::find(known.begin(), known.end(), name);
        if (at == known.end()) {
            item.report(fmt::format("there are no data named \"{}\"{}", name, suggestion(name, known)));
            continue;
        }
        experiments.push_back(static_cast<std::size_t>(at - known.begin()));
        if (check) check(item, job.data[experiments.back()]);
    }
    std::sort(experiments.begin(), experiments.end());
    return experiments;
}

std::optional<double> read_parameter_value(const ValueReader& value, Eigen::Index parameter, const Job& job) {
    const models::Parameter& entry = job.model.parameter(parameter);
    const auto number = value.number();
    if (!number || models::contains(entry.domain, *number)) return number;
    value.report(fmt::format("{} ({}{}) must be {}, not {}", entry.name, entry.description,
                             entry.unit == "1" ? "" : fmt::format(", {}", entry.unit), models::rule(entry.domain),
                             *number));
    return std::nullopt;
}

std::vector<ParameterValue> read_parameter_values(const ValueReader& value, const Job& job) {
    std::vector<ParameterValue> result;
    for (const auto& [name, member] : value.members()) {
        const auto index = parameter_named(name, member, job);
        if (!index) continue;
        if (const auto number = read_parameter_value(member, *index, job)) result.push_back({*index, *number});
    }
    std::sort(result.begin(), result.end(), [](const auto& a, const auto& b) { return a.parameter < b.parameter; });
    return result;
}

std::optional<std::vector<int>> read_periods(const ValueReader& value) {
    std::vector<int> result;
    for (const ValueReader& item : value.items())
        if (const auto period = item.whole()) result.push_back(static_cast<int>(*period));
    if (result.empty()) return std::nullopt;
    return result;
}

Eigen::VectorXd read_numbers(const ValueReader& value) {
    const auto items = value.items();
    Eigen::VectorXd numbers(static_cast<Eigen::Index>(items.size()));
    for (std::size_t i = 0; i < items.size(); ++i)
        numbers[static_cast<Eigen::Index>(i)] = items[i].number().value_or(0.0);
    return numbers;
}

std::optional<Eigen::VectorXd> read_state(const ValueReader& value, const Job& job) {
    if (value.refused()) return std::nullopt;
    const auto items = value.items();
    if (job.model.system && items.size() != job.model.system->coordinates().size()) {
        value.report(fmt::format("must be a state of {} numbers [{}], not {}", job.model.system->coordinates().size(),
                                 fmt::join(coordinate_names(job), ", "), items.size()));
        return std::nullopt;
    }
    if (!value.sound()) return std::nullopt;
    return read_numbers(value);
}

std::vector<Eigen::VectorXd> read_states(const ValueReader& value, const Job& job) {
    std::vector<Eigen::VectorXd> states;
    for (const ValueReader& item : value.items())
        if (const auto state = read_state(item, job)) states.push_back(*state);
    return states;
}

std::optional<Eigen::MatrixXd> read_matrix(const ValueReader& value, Eigen::Index size) {
    const auto rows = value.items();
    bool complete = value.is(JsonValue::Kind::array) && static_cast<Eigen::Index>(rows.size()) == size;
    if (value.is(JsonValue::Kind::array) && !complete)
        value.report(fmt::format("must be a matrix of {} rows, not {}", size, rows.size()));
    Eigen::MatrixXd matrix(size, size);
    for (std::size_t i = 0; complete && i < rows.size(); ++i) {
        const auto cells = rows[i].items();
        complete = static_cast<Eigen::Index>(cells.size()) == size;
        if (!complete) rows[i].report(fmt::format("must be a row of {} numbers, not {}", size, cells.size()));
        for (std::size_t j = 0; complete && j < cells.size(); ++j) {
            const auto number = cells[j].number();
            complete = number.has_value();
            matrix(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = number.value_or(0.0);
        }
    }
    if (!complete) return std::nullopt;
    return matrix;
}

bool is_name(const std::string& name, const ValueReader& at) {
    const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    const bool good = !name.empty() && name.size() <= 100 && letter(name.front()) &&
                      std::all_of(name.begin(), name.end(), [&](char c) { return letter(c) || digit(c); });
    if (!good)
        at.report(fmt::format("\"{}{}\" is no name: letters, digits and _, no digit first, at most 100 characters",
                              name.substr(0, 100), name.size() > 100 ? "..." : ""));
    return good;
}

std::optional<std::filesystem::path> read_path(const ValueReader& value, const Job& job) {
    const auto text = value.text();
    if (!text) return std::nullopt;
    // Relative to the job file; an absolute path replaces the folder.
    const auto path = (job.source.parent_path() / *text).lexically_normal();
    std::error_code error;
    const auto status = std::filesystem::status(path, error);
    if (status.type() == std::filesystem::file_type::not_found) {
        value.report_data(fmt::format("the file \"{}\" does not exist", path.string()));
    } else if (status.type() == std::filesystem::file_type::none) {
        const std::string shown = path.string();
        value.report_data(fmt::format("the file \"{}{}\" cannot be reached: {}", shown.substr(0, 200),
                                      shown.size() > 200 ? "..." : "", error.message()));
    } else if (!std::filesystem::is_regular_file(status)) {
        value.report_data(fmt::format("\"{}\" is no file", path.string()));
    }
    return path;
}

}  // namespace orbid::apps
