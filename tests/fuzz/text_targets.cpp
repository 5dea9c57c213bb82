#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "apps/documents/json_value.hpp"
#include "apps/estimation/checkpoint_fields.hpp"
#include "apps/job/job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/results/branch_file.hpp"
#include "apps/results/cycle_reader.hpp"
#include "apps/results/orbit_file.hpp"
#include "models/equations/equation_text.hpp"
#include "models/formulas/expression.hpp"
#include "models/formulas/expression_graph.hpp"
#include "tests/fuzz/target.hpp"

namespace orbid::fuzz {

namespace {

void job(std::string_view bytes) {
    (void)apps::read_job(bytes, "/nonexistent/job.json");
}

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
        text.coordinates.push_back({std::string(1, static_cast<char>('w' + line)), std::string(bytes.substr(at, end - at))});
        at = end + 1;
    }
    std::vector<models::EquationProblem> problems;
    (void)models::system_from_text(text, problems);
}

void cycles(std::string_view bytes) {
    (void)apps::parse_cycles(bytes, "henon", {{"x", "1", false}, {"y", "1", true}});
}

void orbits(std::string_view bytes) {
    (void)apps::stored_orbits(bytes);
    (void)apps::stored_branches(bytes);
}

/// Behind the checksum, which only tells what a disk lost.
template <class Value>
void archived(std::string_view bytes) {
    try {
        Value value{};
        apps::Archive archive(bytes);
        archive(value);
    } catch (const apps::DamagedCheckpoint&) {
    }
}

void checkpoint(std::string_view bytes) {
    if (bytes.empty()) return;
    const auto kind = static_cast<unsigned char>(bytes.front()) % 4;
    bytes.remove_prefix(1);
    if (kind == 0) archived<std::vector<std::pair<std::string, std::string>>>(bytes);
    if (kind == 1) archived<estimator::Estimate>(bytes);
    if (kind == 2) archived<std::vector<estimator::BlockValue>>(bytes);
    if (kind == 3) archived<std::vector<orbits::Cycle>>(bytes);
}

}  // namespace

std::vector<Target> text_targets() {
    return {{"job", job}, {"formulas", formulas}, {"cycles", cycles}, {"orbits", orbits}, {"checkpoint", checkpoint}};
}

}  // namespace orbid::fuzz
