#include "apps/searched_section.hpp"

#include <string>

#include "apps/cycle_reader.hpp"

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

}  // namespace

SearchedSection searched_section(const Job& job, const orbits::Series& record) {
    SearchedSection section;
    section.options = job.orbits->search;
    Eigen::VectorXd sd = job.orbits->reading_sd;
    section.series = &record;
    if (job.section_plane) {
        const Eigen::Index plane = job.section_plane->coordinate;
        section.cut = without_coordinate(record, plane);
        section.series = &*section.cut;
        if (sd.size() > 0) sd = without_row(sd, plane);
        if (section.options.symmetry_signs)
            section.options.symmetry_signs->erase(section.options.symmetry_signs->begin() + plane);
        if (section.options.partition && section.options.partition->coordinate > plane)
            --section.options.partition->coordinate;
    }
    if (sd.size() > 0) section.options.reading_covariance = sd.cwiseAbs2().asDiagonal();
    return section;
}

std::vector<orbits::SeriesCoordinate> section_coordinates(const Job& job) {
    auto coordinates = series_coordinates(*job.model.system);
    if (job.section_plane) coordinates.erase(coordinates.begin() + job.section_plane->coordinate);
    return coordinates;
}

std::optional<SectionPlane> section_plane(const Job& job) {
    if (!job.section_plane) return std::nullopt;
    const auto& coordinate = job.model.system->coordinates()[static_cast<std::size_t>(job.section_plane->coordinate)];
    return SectionPlane{std::string(coordinate.name), job.section_plane->value, job.section_plane->direction};
}

}  // namespace orbid::apps
