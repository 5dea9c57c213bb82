#include <filesystem>
#include <string>
#include <vector>

#include "models/equations/equation_text.hpp"
#include "models/formulas/expression.hpp"
#include "models/formulas/expression_graph.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/series_file.hpp"
#include "tests/fuzz/target.hpp"

namespace orbid::fuzz {

namespace {

namespace fs = std::filesystem;

/// One formula a line: the first is parsed alone and differentiated, all together are a model.
void formulas(std::string_view bytes) {
    using models::ExpressionGraph;
    static const std::vector<std::string> names{"x", "y", "z", "a", "b", "phase"};
    const std::string_view first = bytes.substr(0, bytes.find('\n'));
    try {
        const models::Expression expression = models::Expression::parse(first, names);
        ExpressionGraph graph;
        std::vector<ExpressionGraph::Node> nodes;
        for (std::size_t i = 0; i < names.size(); ++i)
            nodes.push_back(graph.variable(models::FormulaOperation::coordinate, i));
        const auto node = graph.insert(expression, nodes);
        if (const auto slope = graph.derivative(node, nodes[0])) (void)graph.derivative(*slope, nodes[1]);
        const Eigen::VectorXd values = Eigen::VectorXd::LinSpaced(std::ssize(names), -1.0, 2.0);
        (void)expression.value(values);
        (void)expression.gradient(values);
    } catch (const models::ExpressionError&) {
    }
    models::EquationText text;
    text.parameters = {{"a", "1", models::Domain::real, 1.0}, {"b", "1", models::Domain::real, 0.5}};
    std::size_t line = 0;
    for (std::size_t at = 0; at < bytes.size() && line < 4; ++line) {
        const std::size_t end = std::min(bytes.find('\n', at), bytes.size());
        text.coordinates.push_back(
            {std::string(1, static_cast<char>('w' + line)), std::string(bytes.substr(at, end - at))});
        at = end + 1;
    }
    std::vector<models::EquationProblem> problems;
    (void)models::system_from_text(text, problems);
}

void csv(std::string_view bytes) {
    orbits::TableLayout layout;
    layout.sampling = orbits::Series::Sampling::samples;
    layout.time = "t";
    layout.coordinates = {{{"x", "m", false}, "x", "m", 1.0, 0.0, {}},
                          {{"phi", "rad", true}, "phi", "deg", -1.0, 0.5, "sd"}};
    const fs::path file = written("table.csv", bytes);
    for (const bool segmented : {false, true}) {
        layout.segment = segmented ? "segment" : "";
        layout.nan_is_missing = segmented;
        layout.coordinates[1].sd = segmented ? "sd" : "";
        try {
            (void)orbits::read_csv(file, layout);
        } catch (const orbits::DataError&) {
        }
    }
}

void hdf5(std::string_view bytes) {
    try {
        (void)orbits::read_hdf5(written("series.h5", bytes));
    } catch (const orbits::DataError&) {
    }
}

}  // namespace

std::vector<Target> record_targets() {
    return {{"formulas", formulas}, {"csv", csv}, {"hdf5", hdf5}};
}

}  // namespace orbid::fuzz
