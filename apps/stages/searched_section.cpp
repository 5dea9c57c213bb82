#include "apps/stages/searched_section.hpp"

#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "orbits/records/data_error.hpp"
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

void cut_samples(const Job& job, const std::function<bool()>& interrupted, SearchedSection& section) {
    const DataJob& data = job.data[job.orbits->data];
    orbits::SampledSection cut;
    try {
        if (job.section_plane) {
            const SectionPlaneJob& plane = *job.section_plane;
            cut = plane_section(*section.record, {plane.coordinate, plane.value, plane.direction}, interrupted);
        } else {
            const Eigen::VectorXd values = data.with_own(job.model.values);
            cut = stroboscopic_section(*section.record, job.model.system->period(values, models::Clock::time),
                                       job.section_phase, interrupted);
        }
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{}: no section can be made of its samples: {}", data.name, error.what()));
    }
    section.remark = cutting_remark(cut, *section.record);
    if (!cut.windows.empty()) section.options.reading_covariance = cut.reading_covariance;
    section.cut = std::move(cut.series);
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
    if (samples) cut_samples(job, interrupted, section);
    if (job.section_plane) {
        const Eigen::Index plane = job.section_plane->coordinate;
        if (!samples) section.cut = without_coordinate(record, plane);
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
