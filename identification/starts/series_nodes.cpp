#include "identification/starts/series_nodes.hpp"

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

orbits::Continuity matching(const IdentificationProblem& problem, const Experiment& data) {
    const Matching& asked = problem.series->matching;
    orbits::Continuity result;
    // A simulated record follows its equations; a measured one only as far as the model is right.
    const bool perfect =
        asked.kind == Matching::Kind::exact || (asked.kind == Matching::Kind::automatic && data.follows_model);
    result.kind = perfect ? orbits::Continuity::Kind::exact : orbits::Continuity::Kind::normal;
    if (asked.kind == Matching::Kind::diffusion) result.kind = orbits::Continuity::Kind::diffusion;
    result.estimate = !perfect && asked.kind != Matching::Kind::given;
    if (asked.kind == Matching::Kind::given) result.share = asked.sd;
    return result;
}

/// What is known of the first states; empty where nothing is.
Eigen::VectorXd first_state(const Experiment& data) {
    Eigen::VectorXd state =
        Eigen::VectorXd::Constant(std::ssize(data.initial_state), std::numeric_limits<double>::quiet_NaN());
    for (std::size_t i = 0; i < data.initial_state.size(); ++i)
        if (data.initial_state[i].value) state[static_cast<Eigen::Index>(i)] = *data.initial_state[i].value;
    return state.array().isFinite().any() ? state : Eigen::VectorXd();
}

/// Errors whose sd is estimated begin at these.
void begin_errors(const std::vector<double>& sds, std::vector<estimator::ErrorScale>& errors) {
    for (std::size_t i = 0; i < errors.size() && i < sds.size(); ++i)
        if (errors[i].estimate && !(errors[i].value > 0.0) && sds[i] > 0.0) errors[i].value = sds[i];
}

/// @param place  of the experiment among those of the series.
orbits::ShootingOptions shooting_options(const IdentificationProblem& problem, std::size_t place,
                                         const SeriesStart& start) {
    const SeriesChoice& asked = *problem.series;
    const Experiment& data = problem.experiments[asked.data[place]];
    orbits::ShootingOptions options;
    options.name = asked.data.size() > 1 ? "series." + data.name : "series";
    options.sensor = data.sensor;
    for (const Eigen::Index coordinate : data.observe) {
        options.observe.emplace_back(problem.coordinate(coordinate).name);
        // A rate that is a difference of two readings has the errors of the angle.
        const bool second = data.sensor.type == models::Sensor::Type::angle_difference &&
                            coordinate == static_cast<Eigen::Index>(data.sensor.rate);
        const Eigen::Index own = second ? static_cast<Eigen::Index>(data.sensor.angle) : coordinate;
        for (const RecordErrors& error : asked.errors) {
            if (error.coordinate != own) continue;
            options.errors.push_back(error.scale);
            options.forms.push_back(error_form(error));
        }
    }
    options.segments = data.fitted_segments();
    options.matching = matching(problem, data);
    if (start.follows) options.matching = orbits::Continuity{};
    const std::size_t interval = start.intervals.empty() ? *asked.interval : start.intervals[place];
    options.interval = static_cast<Eigen::Index>(interval);
    options.start = start.theta;
    options.first_state = first_state(data);
    if (!start.nodes.empty()) options.nodes = start.nodes[place];
    if (!start.reading_sds.empty()) begin_errors(start.reading_sds[place], options.errors);
    return options;
}

}  // namespace

SeriesStart nodes_at(const ProblemResiduals& residuals, const estimator::Estimate& estimate) {
    SeriesStart start;
    start.theta = estimated_theta(estimate);
    const std::size_t first = residuals.first_shooting();
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        const orbits::ShootingResidual& residual = *residuals.shooting[i];
        const auto& latents = estimate.latents.at(first + i);
        const auto& nodes = residual.plan().nodes;
        start.intervals.push_back(static_cast<std::size_t>(residual.interval()));
        std::vector<Eigen::MatrixXd>& segments = start.nodes.emplace_back();
        for (std::size_t begin = 0; begin < nodes.size();) {
            std::size_t end = begin;
            while (end < nodes.size() && nodes[end].segment == nodes[begin].segment)
                ++end;
            Eigen::MatrixXd states(latents[begin].size(), static_cast<Eigen::Index>(end - begin));
            for (std::size_t b = begin; b < end; ++b)
                states.col(static_cast<Eigen::Index>(b - begin)) = latents[b];
            segments.push_back(std::move(states));
            begin = end;
        }
    }
    return start;
}

void add_shooting(const IdentificationProblem& problem, const EstimateSetup& setup, const SeriesStart& start,
                  ProblemResiduals& residuals, const std::optional<models::FlowOptions>& flow,
                  FollowedRecords* followed) {
    const auto& experiments = problem.series->data;
    const bool known = followed != nullptr && followed->theta.size() == start.theta.size() &&
                       followed->theta == start.theta && followed->series.size() == experiments.size();
    std::vector<std::shared_ptr<const orbits::FollowedSeries>> found;
    for (std::size_t i = 0; i < experiments.size(); ++i) {
        const std::size_t experiment = experiments[i];
        const Experiment& measured = problem.experiments[experiment];
        orbits::ShootingOptions options = shooting_options(problem, i, start);
        options.inputs = measured.inputs;
        options.delay = setup.delay(measured, experiment);
        if (flow) options.flow = *flow;
        if (known) options.followed = followed->series[i];
        if (followed != nullptr) options.following_work = &followed->work;
        try {
            residuals.shooting.push_back(std::make_unique<orbits::ShootingResidual>(
                problem.system, setup.experiments[experiment], *measured.series, std::move(options)));
        } catch (const orbits::DataError& error) {
            throw orbits::DataError(fmt::format("{}: {}", measured.name, error.what()));
        }
        residuals.shooting_experiments.push_back(experiment);
        found.push_back(residuals.shooting.back()->followed());
    }
    // Residuals with nodes of their own follow nothing.
    if (followed == nullptr || !start.nodes.empty()) return;
    followed->theta = start.theta;
    followed->series = std::move(found);
}

std::unique_ptr<orbits::ShootingResidual> shooting_piece(const IdentificationProblem& problem,
                                                         const EstimateSetup& setup, const SeriesStart& start,
                                                         const SeriesPiece& piece, const Eigen::MatrixXd& nodes,
                                                         const models::FlowOptions& flow) {
    const std::size_t experiment = problem.series->data[piece.place];
    const Experiment& measured = problem.experiments[experiment];
    const std::size_t segment = measured.fitted_segments()[piece.segment];
    orbits::ShootingOptions options = shooting_options(problem, piece.place, start);
    options.matching = orbits::Continuity{};
    options.flow = flow;
    options.nodes = {nodes};
    options.segments = {0};
    options.delay = setup.delay(measured, experiment);
    if (!measured.inputs.empty()) options.inputs = {measured.inputs[segment]};
    for (estimator::ErrorScale& error : options.errors)
        if (error.value > 0.0) error.estimate = false;
    // All but the segments: records may be long, and pieces many.
    const orbits::Segment& whole = measured.series->segments[segment];
    orbits::Series series;
    series.sampling = measured.series->sampling;
    series.coordinates = measured.series->coordinates;
    series.phase = measured.series->phase;
    const Eigen::Index first = piece.node * options.interval;
    const Eigen::Index count = std::min(nodes.cols() * options.interval, whole.values.cols() - first);
    orbits::Segment& part = series.segments.emplace_back();
    part.label = whole.label;
    part.values = whole.values.middleCols(first, count);
    if (whole.times.size() > 0) part.times = whole.times.segment(first, count);
    if (whole.deviations.size() > 0) part.deviations = whole.deviations.middleCols(first, count);
    return std::make_unique<orbits::ShootingResidual>(problem.system, setup.experiments[experiment], std::move(series),
                                                      std::move(options));
}

}  // namespace orbid::identification
