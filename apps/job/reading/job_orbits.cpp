#include <algorithm>
#include <cstddef>

#include "apps/job/job_parts.hpp"
#include "orbits/local_maps/local_map.hpp"

namespace orbid::apps {

namespace {

/// Number of coefficients of a local map of n coordinates, intercept included, plus the two that
/// CycleSearchOptions::neighbours asks for.
std::uint64_t fewest_neighbours(std::size_t n, int order) {
    // Left to the data, the order may be as low as 1.
    return static_cast<std::uint64_t>(orbits::coefficient_count(static_cast<Eigen::Index>(n), std::max(order, 1))) + 2;
}

void read_symmetry(ObjectReader& object, const Job& job, OrbitsJob& orbits) {
    const auto value = object.find("symmetry");
    const auto symmetry = job.model.system ? job.model.system->symmetry() : std::nullopt;
    // A symmetry with a shift in phase maps the section onto another one, and so does one that moves its plane.
    const bool usable =
        symmetry && symmetry->phase_shift == 0.0 &&
        (!job.section_plane || symmetry->signs[static_cast<std::size_t>(job.section_plane->coordinate)] > 0.0);
    bool wanted = usable;
    if (value) wanted = value->boolean().value_or(usable);
    if (wanted && usable) orbits.search.symmetry_signs = symmetry->signs;
    if (wanted && !usable && job.model.system)
        value->report(fmt::format("the model {} has no symmetry that maps the section onto itself; must be false",
                                  job.model.name));
}

/// { "coordinate": "x", "boundaries": [0], "symbols": "AB" }
void read_partition(const ValueReader& value, const Job& job, OrbitsJob& orbits) {
    orbits::Partition partition;
    ObjectReader object(value);
    if (const auto coordinate = object.find("coordinate")) {
        const auto name = coordinate->text();
        if (name) partition.coordinate = coordinate_named(*name, *coordinate, job).value_or(0);
        if (name && job.section_plane && partition.coordinate == job.section_plane->coordinate)
            coordinate->report("has the same value at all points of the section; must be another coordinate");
    }
    if (const auto boundaries = object.find("boundaries")) {
        for (const ValueReader& item : boundaries->items()) {
            const auto number = item.number();
            if (number && !partition.boundaries.empty() && !(*number > partition.boundaries.back()))
                item.report(fmt::format("must be above the boundary before it, {}", partition.boundaries.back()));
            partition.boundaries.push_back(number.value_or(0.0));
        }
    }
    if (const auto symbols = object.find("symbols")) {
        partition.symbols = symbols->text().value_or("");
        if (symbols->is(JsonValue::Kind::string) && partition.symbols.size() != partition.boundaries.size() + 1)
            symbols->report(fmt::format("must have one character per part: {}, not {}", partition.boundaries.size() + 1,
                                        partition.symbols.size()));
    }
    object.finish();
    orbits.search.partition = std::move(partition);
}

/// "estimate", or { "phi": 1e-3, "phi_dot": 0.02 }: sds of all coordinates that the section has.
void read_reading_error(const ValueReader& value, const Job& job, OrbitsJob& orbits) {
    if (value.is(JsonValue::Kind::string)) {
        (void)value.choice({"estimate"});
        return;
    }
    const auto names = coordinate_names(job);
    Eigen::VectorXd sds = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(names.size()));
    ObjectReader object(value);
    for (std::size_t i = 0; i < names.size(); ++i) {
        if (job.section_plane && static_cast<Eigen::Index>(i) == job.section_plane->coordinate) continue;
        if (const auto sd = object.require(names[i], "the sd of a reading, in the coordinate's unit"))
            sds[static_cast<Eigen::Index>(i)] = sd->number().value_or(1.0);
    }
    object.finish();
    orbits.reading_sd = std::move(sds);
}

/// true, false, or { "complete_to": 8, "continuous": true } for a cycle expansion beside those of the series.
void read_invariants(const ValueReader& value, OrbitsJob& orbits) {
    if (!value.is(JsonValue::Kind::object)) {
        orbits.invariants = value.boolean().value_or(false);
        return;
    }
    ObjectReader object(value);
    orbits.invariants = true;
    if (const auto period = object.find("complete_to")) {
        const int longest = *std::max_element(orbits.search.periods.begin(), orbits.search.periods.end());
        orbits.expansion.complete_to =
            static_cast<int>(period->whole(1, static_cast<std::uint64_t>(longest)).value_or(1));
        for (int p = 1; p <= orbits.expansion.complete_to; ++p)
            if (std::count(orbits.search.periods.begin(), orbits.search.periods.end(), p) == 0)
                period->report(fmt::format("period {} is not searched for: it does not stand in /orbits/periods", p));
    }
    object.read("continuous", orbits.expansion.continuous);
    object.finish();
}

void read_search(ObjectReader& object, const Job& job, OrbitsJob& orbits) {
    using Method = orbits::CycleSearchOptions::Method;
    orbits::CycleSearchOptions& search = orbits.search;
    object.choose("method", cycle_method_names, search.method);
    if (search.method == Method::closest_return) {
        search.box = 0.01;  // the paper's
        search.minimum_recurrences = 3;
    }
    if (const auto periods = object.find("periods")) search.periods = read_periods(*periods).value_or(search.periods);
    object.read("box", search.box);
    const auto order = object.choose("local_map", local_map_names, search.order);
    if (order && search.method == Method::closest_return && search.order > 1)
        order->report("with \"method\": \"closest_return\" maps are linear: must be \"linear\" or left out");
    if (const auto neighbours = object.find("neighbours")) {
        const std::size_t n = std::max<std::size_t>(coordinate_names(job).size(), 1);
        const auto number =
            neighbours->number([&](double x) { return x >= static_cast<double>(fewest_neighbours(n, search.order)); },
                               fmt::format("at least {}, the coefficients of a local map and two more",
                                           fewest_neighbours(n, search.order)));
        search.neighbours = static_cast<int>(number.value_or(0));
    }
    object.read("minimum_recurrences", search.minimum_recurrences);
    if (const auto partition = object.find("partition")) read_partition(*partition, job, orbits);
    if (const auto error = object.find("reading_error")) read_reading_error(*error, job, orbits);
    if (const auto invariants = object.find("invariants")) read_invariants(*invariants, orbits);
    read_symmetry(object, job, orbits);
}

/// The first section series is searched; without one the first record of samples, cut by the job's section.
void choose_series(const ObjectReader& object, const Job& job, OrbitsJob& orbits) {
    const auto is = [](orbits::Series::Sampling sampling) {
        return [sampling](const DataJob& data) { return data.sampling() == sampling; };
    };
    auto series = std::find_if(job.data.begin(), job.data.end(), is(orbits::Series::Sampling::section));
    const bool samples = series == job.data.end();
    if (samples) series = std::find_if(job.data.begin(), job.data.end(), is(orbits::Series::Sampling::samples));
    if (series == job.data.end()) {
        object.self().report("needs a series in \"data\", or the \"file\" of a list of cycles");
        return;
    }
    orbits.data = static_cast<std::size_t>(series - job.data.begin());
    if (samples && job.model.is(models::Kind::autonomous) && !job.section_plane)
        object.self().report(
            fmt::format("samples of {} are cut by a plane: needs \"section\": {{ \"coordinate\": ..., "
                        "\"value\": ..., \"direction\": ... }}",
                        job.model.name));
    if (samples && orbits.reading_sd.size() > 0)
        object.self().report(
            "the errors of a section cut from samples follow from these: \"reading_error\" must be "
            "\"estimate\"");
    if (series->sensor.type == models::Sensor::Type::function)
        object.self().report(fmt::format("cycles read by a sensor \"function\": {}", not_in_this_version));
    if (std::any_of(series + 1, job.data.end(), is(series->sampling())))
        object.self().report(fmt::format("cycles of several series: {}", not_in_this_version));
    if (job.model.system && series->observe.size() < job.model.system->coordinates().size())
        object.self().report(fmt::format("needs every coordinate of the model, but \"{}\" observes {} of {}",
                                         series->name, series->observe.size(), job.model.system->coordinates().size()));
}

}  // namespace

void read_orbits(ObjectReader& root, Job& job) {
    const auto value = root.find("orbits");
    if (!value) return;
    OrbitsJob orbits;
    ObjectReader object(*value);
    if (const auto file = object.find("file")) {
        orbits.file = read_path(*file, job);
        orbits.sha256 = read_sha256(object);
    } else if (object.valid()) {
        read_search(object, job, orbits);
        // Otherwise it is not known which series there are.
        const auto data = root.find("data");
        if (!data || data->sound()) choose_series(object, job, orbits);
    }
    object.finish();
    job.orbits = std::move(orbits);
}

}  // namespace orbid::apps
