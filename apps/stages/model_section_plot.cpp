#include "apps/stages/model_section_plot.hpp"

#include <fmt/format.h>

#include "apps/drawing/chart_picture.hpp"
#include "apps/drawing/section_plot.hpp"
#include "apps/results/cycle_file.hpp"
#include "apps/stages/periodic_stage.hpp"
#include "periodic/search/model_section.hpp"

namespace orbid::apps {

namespace {

// Enough dots to see the attractor, and less than a second of simulation for every model in the registry.
constexpr std::size_t dots = 40000;
constexpr std::size_t trajectories = 16;
// Of every trajectory this share is the way to the attractor: at least some hundred sections.
constexpr double transient_share = 0.2;

orbits::Series own_section(const Job& job) {
    const models::System& system = *job.model.system;
    models::FlowOptions coarse;  // a dot is a thousandth of the picture
    coarse.relative_tolerance = coarse.absolute_tolerance = 1e-8;
    const auto plane = job_section(job);
    const periodic::ModelSection section{system, job.model.values, job.section_phase, plane,
                                         periodic::longest_return(system, job.model.values, plane, job.seed, coarse)};
    periodic::SectionPiecesOptions options;
    options.points = dots;
    options.trajectories = trajectories;
    options.seed = job.seed;
    options.flow = coarse;
    orbits::Series series;
    series.sampling = orbits::Series::Sampling::section;
    series.coordinates = series_coordinates(system);
    for (const Eigen::MatrixXd& piece : simulate_pieces(section, options).pieces) {
        const auto kept = static_cast<Eigen::Index>((1.0 - transient_share) * static_cast<double>(piece.cols()));
        orbits::Segment segment;
        segment.values = piece.rightCols(kept);
        series.segments.push_back(std::move(segment));
    }
    return series;
}

}  // namespace

std::optional<std::string> model_section_svg(const Job& job, const ComputedOrbits& orbits) {
    const models::System& system = *job.model.system;
    if (system.kind() == models::Kind::autonomous && !job.section_plane) return std::nullopt;
    std::vector<Eigen::Index> shown;
    for (Eigen::Index i = 0; i < system.dimension(); ++i)
        if (!job.section_plane || i != job.section_plane->coordinate) shown.push_back(i);
    if (shown.size() < 2) return std::nullopt;
    SectionPicture picture;
    for (const ComputedOrbit& computed : orbits.list)
        if (computed.converged()) picture.add_orbit(computed.orbit.period, computed.orbit.points, shown[0], shown[1]);
    picture.section = section_points(own_section(job), shown[0], shown[1]);
    picture.title = job.title.empty() ? "Section and periodic points" : job.title;
    picture.description = fmt::format("{} periodic orbits of the model, over {} points of its section",
                                      orbits.converged(), picture.section.x.size());
    return chart_svg(section_chart(picture), picture.title, run_picture_style);
}

}  // namespace orbid::apps
