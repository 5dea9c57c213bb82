#include "apps/stored_run/stored_record.hpp"

#include <algorithm>
#include <cctype>
#include <string_view>

#include "orbits/records/data_error.hpp"

namespace orbid::apps::catalog {

bool is_cycle(const ResidualRow& row) {
    return row.block.starts_with("cycle ");
}

std::vector<ResidualRow> rows_of(const StoredRun& run) {
    auto rows = stored_residuals(run);
    if (rows.empty()) throw orbits::DataError((run.folder / "residuals.csv").string() + ": holds no records");
    return rows;
}

std::string time_unit(const ModelJob& model) {
    const auto has_seconds = [](std::string_view unit) {
        for (std::size_t k = 0; k < unit.size(); ++k) {
            const bool begins = k == 0 || std::isalpha(static_cast<unsigned char>(unit[k - 1])) == 0;
            const bool ends = k + 1 == unit.size() || std::isalpha(static_cast<unsigned char>(unit[k + 1])) == 0;
            if (unit[k] == 's' && begins && ends) return true;
        }
        return false;
    };
    for (const auto& parameter : model.system->parameters())
        if (has_seconds(parameter.unit)) return "s";
    for (const auto& coordinate : model.system->coordinates())
        if (has_seconds(coordinate.unit)) return "s";
    return {};
}

orbits::SeriesCoordinate coordinate_of(const ModelJob& model, const std::string& name) {
    const Eigen::Index index = model.system->coordinate_index(name);
    if (index < 0) return {name, "", false};
    const auto& coordinate = model.coordinate(index);
    return {name, coordinate.unit == "1" ? std::string() : std::string(coordinate.unit), coordinate.angle};
}

std::size_t stride(std::size_t count, std::size_t most) {
    return std::max<std::size_t>(1, (count + most - 1) / most);
}

bool is_sampled(const StoredRun& run, const std::string& experiment) {
    for (const StoredRun::Json* one : run.experiments()) {
        if (one->value("name", std::string()) != experiment) continue;
        if (one->contains("kind")) return (*one)["kind"] == "samples";
        return one->contains("simulate") && (*one)["simulate"].contains("samples");
    }
    return true;
}

}  // namespace orbid::apps::catalog
