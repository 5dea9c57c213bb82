#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include "apps/results/result_file.hpp"
#include "models/system/stopped.hpp"

namespace orbid::apps {

std::string residuals_text(const std::vector<ResidualRow>& rows, const std::function<bool()>& interrupted) {
    constexpr std::ptrdiff_t asked_every = 65536;
    fmt::memory_buffer out;
    const auto number = [&out](double value, char end) {
        if (std::isfinite(value)) {
            fmt::format_to(std::back_inserter(out), "{}{}", value, end);
        } else {
            out.push_back(end);
        }
    };
    fmt::format_to(std::back_inserter(out),
                   "experiment,segment_or_cycle,coordinate,time_or_phase,observed,predicted,sd\n");
    for (const ResidualRow& row : rows) {
        if ((&row - rows.data()) % asked_every == 0) models::stop_if_asked(interrupted);
        fmt::format_to(std::back_inserter(out), "{},{},{},", csv_cell(row.experiment), csv_cell(row.block),
                       csv_cell(row.coordinate));
        number(row.at, ',');
        number(row.observed, ',');
        number(row.predicted, ',');
        number(row.sd, '\n');
    }
    return fmt::to_string(out);
}

}  // namespace orbid::apps
