#include <algorithm>
#include <optional>

#include "apps/documents/atomic_file.hpp"
#include "apps/drawing/branch_plot.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/results/branch_file.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps::catalog {

namespace {

/// Which coordinate of the points is shown upwards; none: the time T.
std::optional<Eigen::Index> shown_coordinate(const StoredRun& run) {
    const auto pointer = StoredRun::Json::json_pointer("/periodic/continuation/plot");
    if (!run.job.contains(pointer) || !run.job.at(pointer).is_string()) return std::nullopt;
    const auto& names = run.branch->at("coordinates");
    const auto found = std::find(names.begin(), names.end(), run.job.at(pointer));
    if (found == names.end()) return std::nullopt;
    return found - names.begin();
}

}  // namespace

bool has_branch(const StoredRun& run) {
    return run.branch && run.branch->contains("branches") && !run.branch->at("branches").empty();
}

std::string branch(const StoredRun& run, const PlotStyle& style) {
    const auto file = run.folder / "branch.json";
    const auto stored = stored_branches(read_whole_file(file));
    if (!stored) throw orbits::DataError(file.string() + ": does not hold the branches of this version");
    const auto& parameter = run.branch->at("parameter");
    BranchPicture picture;
    picture.parameter = {parameter.at("name").get<std::string>(), parameter.at("unit").get<std::string>(), false};
    picture.shown = shown_coordinate(run);
    picture.heading = run.title();
    picture.title = "Branches of periodic orbits";
    if (picture.shown)
        picture.coordinate =
            coordinate_of(stored_model(run),
                          run.branch->at("coordinates")[static_cast<std::size_t>(*picture.shown)].get<std::string>());
    return branches_svg(stored->followed.branches, picture, style);
}

}  // namespace orbid::apps::catalog
