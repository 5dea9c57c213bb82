#include "apps/stages/branch_stage.hpp"

#include <limits>
#include <utility>
#include <variant>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/drawing/branch_plot.hpp"
#include "apps/drawing/chart_picture.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/branch_file.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/periodic_stage.hpp"
#include "apps/stages/workspace.hpp"
#include "periodic/branches/continuation.hpp"

namespace orbid::apps {

namespace {

std::optional<FollowedBranches> branches_from_folder(const Workspace& work, const Fingerprint& wanted) {
    const auto file = work.file("branch.json");
    if (!std::filesystem::exists(file)) return std::nullopt;
    auto stored = stored_branches(read_whole_file(file));
    if (!reusable(work, Stage::periodic, file, stored ? stored->fingerprint : std::string(), wanted))
        return std::nullopt;
    return std::move(stored->followed);
}

FollowedBranches followed_from(const Workspace& work, const ComputedOrbits& orbits) {
    const Job& job = work.job;
    const ContinuationJob& continuation = *job.periodic->continuation;
    FollowedBranches followed;
    if (continuation.orbit >= orbits.list.size()) {
        followed.message = orbits.list.empty() ? "there is no orbit to start from"
                                               : fmt::format("there is no orbit {} to start from: the last one is {}",
                                                             continuation.orbit, orbits.list.size() - 1);
        return followed;
    }
    const ComputedOrbit& start = orbits.list[continuation.orbit];
    if (!start.converged()) {
        followed.message = fmt::format("orbit {} is no start: {}{}{}", continuation.orbit, start.status(),
                                       start.message.empty() ? "" : ", ", start.message);
        return followed;
    }
    periodic::ContinuationOptions options = continuation.options;
    if (const auto* shooting = std::get_if<periodic::ShootingOptions>(&job.periodic->method))
        options.solver = *shooting;
    options.solver.maximum_distance = std::numeric_limits<double>::infinity();
    options.interrupted = [&work] { return work.interruption.asked(); };
    double count = 0.0;
    const std::string parameter(job.model.parameter(options.parameter).name);
    options.progress = [&work, &count, &parameter](std::size_t points, double value) {
        work.progress.at(++count, fmt::format("point {} at {} = {:.6g}", points, parameter, value));
    };
    auto diagram =
        periodic::follow_branches(work.system(), job.model.values, starting_solution(job, start.orbit), options);
    if (diagram.branches.empty())
        followed.message =
            fmt::format("no branch begins at orbit {}: {}", continuation.orbit, periodic::name(diagram.start_status));
    followed.branches = std::move(diagram.branches);
    thin_out(job, followed.branches);
    return followed;
}

}  // namespace

void thin_out(const Job& job, std::vector<periodic::Branch>& branches) {
    const bool free_mesh = job.model.is(models::Kind::autonomous) && !job.section_plane;
    for (periodic::Branch& branch : branches) {
        for (periodic::BranchPoint& point : branch.points) {
            point.orbit.jacobians.clear();
            if (free_mesh && point.orbit.points.cols() > 1) point.orbit.points = point.orbit.points.leftCols(1).eval();
        }
    }
}

FollowedBranches follow_job_branches(const Workspace& work, const ComputedOrbits& orbits) {
    const Job& job = work.job;
    const ContinuationJob& continuation = *job.periodic->continuation;
    const Fingerprint wanted = stage_fingerprint(work.document, {"/model", "/section", "/flow", "/periodic"});
    if (auto stored = branches_from_folder(work, wanted)) {
        work.progress.reused("branches", fmt::format("{} branches from branch.json", stored->branches.size()));
        return std::move(*stored);
    }
    work.progress.begin("branches", 0.0, "steps");
    FollowedBranches followed = followed_from(work, orbits);
    std::size_t points = 0;
    for (const periodic::Branch& branch : followed.branches)
        points += branch.points.size();
    work.progress.end(fmt::format("{} branch{} of {} orbits", followed.branches.size(),
                                  followed.branches.size() == 1 ? "" : "es", points));
    if (!followed.message.empty()) work.progress.say(followed.message);

    const auto& parameter = work.job.model.parameter(continuation.options.parameter);
    CycleFileHead head = cycle_file_head(job, work.interruption.asked() ? Fingerprint{} : wanted);
    head.coordinates = series_coordinates(work.system());
    work.folder.store("branch.json",
                      branches_text(head, parameter, continuation.options.lower, continuation.options.upper, followed));
    if (followed.branches.empty()) return followed;
    work.folder.store("branch.csv", branches_csv(head, parameter, followed));
    BranchPicture picture;
    picture.parameter = {std::string(parameter.name), std::string(parameter.unit), false};
    picture.shown = continuation.plotted;
    if (picture.shown) picture.coordinate = head.coordinates.at(static_cast<std::size_t>(*picture.shown));
    if (continuation.measure) show_measure(*continuation.measure, picture);
    picture.title = job.title.empty() ? "Branches of periodic orbits" : job.title;
    work.folder.store("branch.svg",
                      chart_svg(branch_chart(followed.branches, picture), picture.title, run_picture_style));
    return followed;
}

}  // namespace orbid::apps
