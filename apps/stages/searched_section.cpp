#include "apps/stages/searched_section.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/stages/short_record.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/sections/delay_embedding.hpp"
#include "orbits/sections/plane_choice.hpp"
#include "orbits/sections/sampled_section.hpp"

namespace orbid::apps {

namespace {

/// All rows but one.
Eigen::MatrixXd without_row(const Eigen::MatrixXd& values, Eigen::Index row) {
    if (values.rows() == 0) return values;
    Eigen::MatrixXd rest(values.rows() - 1, values.cols());
    rest.topRows(row) = values.topRows(row);
    rest.bottomRows(rest.rows() - row) = values.bottomRows(rest.rows() - row);
    return rest;
}

orbits::Series without_coordinate(const orbits::Series& record, Eigen::Index coordinate) {
    orbits::Series rest = record;
    rest.coordinates.erase(rest.coordinates.begin() + coordinate);
    for (orbits::Segment& segment : rest.segments) {
        segment.values = without_row(segment.values, coordinate);
        segment.deviations = without_row(segment.deviations, coordinate);
    }
    return rest;
}

/// What was done, with the sds of the samples that were smoothed.
std::string cutting_remark(const orbits::SampledSection& section, const orbits::Series& record) {
    std::string text = fmt::format("{} points of the section from {} samples", section.series.size(), record.size());
    if (section.windows.empty()) return text + ", taken as they are";
    text += "; sd of a sample";
    for (Eigen::Index i = 0; i < section.sample_deviation.size(); ++i)
        text += fmt::format("{} {} {:.2g}", i == 0 ? "" : ",", record.coordinates[static_cast<std::size_t>(i)].name,
                            section.sample_deviation[i]);
    if (section.breaks > 0) text += fmt::format("; cut in {} places by holes or doubtful crossings", section.breaks);
    return text;
}

/// The record of the only coordinate that is read, as vectors of its delays.
orbits::Series embedded_samples(const Job& job, const orbits::Series& record, SearchedSection& section) {
    const DataJob& data = job.data[job.orbits->data];
    const std::string name(job.model.coordinate(data.observe.front()).name);
    const auto row = std::find_if(record.coordinates.begin(), record.coordinates.end(),
                                  [&](const orbits::SeriesCoordinate& one) { return one.name == name; });
    if (row == record.coordinates.end()) throw orbits::DataError(fmt::format("there is no coordinate {}", name));
    orbits::DelayEmbeddingOptions options;
    options.coordinate = row - record.coordinates.begin();
    options.delay = job.orbits->embedding->delay;
    options.dimension = job.orbits->embedding->dimension;
    options.rise = true;
    // Reading errors make neighbours false in any dimension: the model's own is enough for its section.
    options.largest_dimension = static_cast<int>(job.model.system->dimension());
    orbits::DelayEmbedding embedding;
    try {
        embedding = orbits::embed(record, options);
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{} cannot be embedded: {}", name, error.what()));
    }
    std::string text = fmt::format("states are vectors of {} readings of {}, {} samples apart", embedding.dimension,
                                   name, embedding.delay);
    if (options.delay == 0)
        text += embedding.minimum_found ? ": the first minimum of the mutual information"
                                        : ": where the mutual information has fallen to 1/e, as it has no minimum";
    if (options.dimension == 0 && !embedding.false_neighbours.empty())
        text += fmt::format("; {:.2g} % false neighbours{}", 100.0 * embedding.false_neighbours.back(),
                            embedding.unfolded ? "" : ", more than 1 %, also in the largest dimension tried");
    section.choices.push_back(std::move(text));
    return std::move(embedding.series);
}

/// The coordinate of a plane has no errors at its points: what a job says about them is not used.
void leave_out_errors(const Job& job, const std::string& name, SearchedSection& section) {
    if (!job.estimate || !job.estimate->cycles) return;
    const CyclesResidualJob& cycles = *job.estimate->cycles;
    const Eigen::Index plane = job.model.system->coordinate_index(name);
    for (const CovarianceJob& one : cycles.covariances)
        if (std::find(one.coordinates.begin(), one.coordinates.end(), plane) != one.coordinates.end())
            throw orbits::DataError(
                fmt::format("the data choose a plane across {}, which is in a \"covariance\" of the errors of cycles "
                            "but has one value at all points of the plane; leave it out there, or give the job's "
                            "\"section\"",
                            name));
    for (const ErrorJob& error : cycles.errors) {
        const bool usual = error.scale.estimate && !(error.scale.value > 0.0) && error.floor == 0.0 &&
                           std::holds_alternative<estimator::FlatPrior>(error.scale.prior) &&
                           std::holds_alternative<estimator::NormalErrors>(error.distribution);
        if (error.coordinate == plane && !usual)
            section.choices.push_back(fmt::format(
                "the errors given for {} are not used: it has one value at all points of the section that the data "
                "chose",
                name));
    }
}

/// The job's plane among the coordinates of `samples`, or the one chosen by these.
orbits::PlaneCrossing plane_of(const Job& job, const orbits::Series& samples, SearchedSection& section) {
    const bool embedded = job.orbits->embedding.has_value();
    orbits::PlaneCrossing crossing;
    if (job.section_plane) {
        const SectionPlaneJob& plane = *job.section_plane;
        crossing = {embedded ? 0 : plane.coordinate, plane.value, plane.direction};
    } else {
        orbits::Series shown = samples;
        std::vector<bool> zero;
        if (embedded) {
            // Later delays repeat what the first says.
            zero = {false, true};
            shown.coordinates.resize(2);
            for (orbits::Segment& segment : shown.segments)
                segment.values = orbits::Readings(Eigen::MatrixXd(segment.values.topRows(2)));
        }
        const orbits::ChosenPlane chosen = orbits::choose_plane(shown, zero);
        crossing = chosen.crossing;
        section.choices.push_back(fmt::format(
            "the section is {} = {:.6g}, {}: of the planes tried it has the most even returns, {} of {:.3g} s, sd "
            "{:.2g} %",
            samples.coordinate(crossing.coordinate).name, crossing.value, crossing.direction > 0 ? "rising" : "falling",
            chosen.crossings, chosen.mean_return, 100.0 * chosen.unevenness));
        if (!embedded) leave_out_errors(job, samples.coordinate(crossing.coordinate).name, section);
    }
    section.plane = SectionPlane{samples.coordinate(crossing.coordinate).name, crossing.value, crossing.direction};
    return crossing;
}

void cut_samples(const Job& job, const std::function<bool()>& interrupted, SearchedSection& section) {
    const DataJob& data = job.data[job.orbits->data];
    orbits::SampledSection cut;
    try {
        if (job.model.is(models::Kind::autonomous)) {
            std::optional<orbits::Series> embedded;
            if (job.orbits->embedding) embedded = embedded_samples(job, *section.record, section);
            const orbits::Series& samples = embedded ? *embedded : *section.record;
            const orbits::PlaneCrossing crossing = plane_of(job, samples, section);
            cut = plane_section(samples, crossing, interrupted);
            section.remark = cutting_remark(cut, samples);
            // What the model declares belongs to its own states.
            auto& signs = section.options.symmetry_signs;
            if (signs && (embedded || !((*signs)[static_cast<std::size_t>(crossing.coordinate)] > 0.0))) signs.reset();
            if (signs) signs->erase(signs->begin() + crossing.coordinate);
            auto& partition = section.options.partition;
            if (partition && partition->coordinate == crossing.coordinate)
                throw orbits::DataError(
                    fmt::format("the partition divides {}, which is the same at all points of the section",
                                samples.coordinate(crossing.coordinate).name));
            if (partition && partition->coordinate > crossing.coordinate) --partition->coordinate;
        } else {
            const Eigen::VectorXd values = data.with_own(job.model.values);
            cut = stroboscopic_section(*section.record, job.model.system->period(values, models::Clock::time),
                                       job.section_phase, interrupted);
            section.remark = cutting_remark(cut, *section.record);
        }
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{}: no section can be made of its samples: {}. {}", data.name,
                                            error.what(), without_section(*section.record)));
    }
    if (!cut.windows.empty()) section.options.reading_covariance = cut.reading_covariance;
    section.cut = std::move(cut.series);
    section.coordinates = section.cut->coordinates;
}

/// Reading errors of a record of nothing but an angle and its difference quotient: both come from two readings of the
/// angle, whose error is that of the encoder's step and of simulated noise; empty for others.
///
///     Cov = q [[1, -1/d], [-1/d, 2/d^2]],  q = step^2 / 12 + noise^2,  d = delay    (mathematics.md, "Instrument")
Eigen::MatrixXd difference_covariance(const DataJob& data, Eigen::Index dimension) {
    const models::Sensor& sensor = data.sensor;
    if (sensor.type != models::Sensor::Type::angle_difference || dimension != 2 || !(sensor.step > 0.0)) return {};
    double q = sensor.step * sensor.step / 12.0;
    const auto angle = static_cast<Eigen::Index>(sensor.angle);
    const auto rate = static_cast<Eigen::Index>(sensor.rate);
    if (data.simulation) q += data.simulation->noise[angle] * data.simulation->noise[angle];
    Eigen::MatrixXd covariance(2, 2);
    covariance(angle, angle) = q;
    covariance(angle, rate) = covariance(rate, angle) = -q / sensor.delay;
    covariance(rate, rate) = 2.0 * q / (sensor.delay * sensor.delay);
    return covariance;
}

}  // namespace

SearchedSection searched_section(const Job& job, const orbits::Series& record,
                                 const std::function<bool()>& interrupted) {
    SearchedSection section;
    section.record = &record;
    section.options = job.orbits->search;
    Eigen::VectorXd sd = job.orbits->reading_sd;
    const bool samples = record.sampling == orbits::Series::Sampling::samples;
    if (samples) {
        cut_samples(job, interrupted, section);
    } else {
        section.coordinates = section_coordinates(job);
        section.plane = section_plane(job);
    }
    if (job.section_plane && !samples) {
        const Eigen::Index plane = job.section_plane->coordinate;
        section.cut = without_coordinate(record, plane);
        if (sd.size() > 0) sd = without_row(sd, plane);
        if (section.options.symmetry_signs)
            section.options.symmetry_signs->erase(section.options.symmetry_signs->begin() + plane);
        if (section.options.partition && section.options.partition->coordinate > plane)
            --section.options.partition->coordinate;
    }
    if (sd.size() > 0) {
        section.options.reading_covariance = sd.cwiseAbs2().asDiagonal();
    } else if (!samples) {
        section.options.reading_covariance =
            difference_covariance(job.data[job.orbits->data], section.series().dimension());
    }
    return section;
}

std::vector<orbits::SeriesCoordinate> section_coordinates(const Job& job) {
    auto coordinates = series_coordinates(*job.model.system);
    if (job.section_plane) coordinates.erase(coordinates.begin() + job.section_plane->coordinate);
    return coordinates;
}

std::optional<SectionPlane> section_plane(const Job& job) {
    if (!job.section_plane) return std::nullopt;
    const auto& coordinate = job.model.coordinate(job.section_plane->coordinate);
    return SectionPlane{std::string(coordinate.name), job.section_plane->value, job.section_plane->direction};
}

}  // namespace orbid::apps
