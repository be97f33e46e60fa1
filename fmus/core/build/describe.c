/* describe.c - host tool: prints the modelDescription.xml of the model it is linked with.
 *
 *     describe VERSION DATE SOURCE...
 *                 DATE as 2026-01-31T00:00:00Z; SOURCE: the .c files in sources/
 *
 * It refuses an interface that is not fit to ship: missing texts, doubled names, unknown units,
 * start values that break their rules, outputs that are not finite for the start values. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "interface.h"

#include <stdlib.h>

#ifndef EXPERIMENT /* of a whole system */
#define EXPERIMENT "startTime=\"0\" stopTime=\"100\" stepSize=\"0.1\""
#endif

static int faults = 0;

static void fault(const char *name, const char *what)
{
    fprintf(stderr, "%s: %s: %s\n", fmu_model.name, name, what);
    faults++;
}

/* ---- units: products of kg m s rad N J with exponents ("kg.m2", "1/(N.m)"); "1": none ---- */
typedef struct { int kg, m, s, rad; } Dimension;

static const struct {
    const char *symbol;
    Dimension dimension;
} base_units[] = {
    {"rad", {0, 0, 0, 1}}, {"kg", {1, 0, 0, 0}}, {"m", {0, 1, 0, 0}}, {"s", {0, 0, 1, 0}},
    {"N", {1, 1, -2, 0}},  {"J", {1, 2, -2, 0}}, {"1", {0, 0, 0, 0}},
};

/* one factor such as "s2" at *text, counted `sign` times; 0 if it is unknown */
static int parse_factor(const char **text, int sign, Dimension *d)
{
    for (size_t i = 0; i < COUNT(base_units); i++) {
        size_t length = strlen(base_units[i].symbol);
        if (strncmp(*text, base_units[i].symbol, length) != 0) continue;
        *text += length;
        int exponent = **text >= '2' && **text <= '9' ? *(*text)++ - '0' : 1;
        if (**text && !strchr("./)", **text)) return 0;
        d->kg += sign * exponent * base_units[i].dimension.kg;
        d->m += sign * exponent * base_units[i].dimension.m;
        d->s += sign * exponent * base_units[i].dimension.s;
        d->rad += sign * exponent * base_units[i].dimension.rad;
        return 1;
    }
    return 0;
}

static int parse_unit(const char *text, Dimension *d)
{
    int sign = 1;
    *d = (Dimension){0, 0, 0, 0};
    while (parse_factor(&text, sign, d)) {
        if (*text == ')' && sign < 0) text++;
        if (!*text) return 1;
        if (*text++ == '/')
            sign = -1; /* all that follows is a divisor, in brackets if it is several factors */
        if (*text == '(' && sign < 0) text++;
    }
    return 0;
}

/* ---- printing ---- */
static void print_text(const char *text) /* XML attribute value */
{
    for (; *text; text++)
        if (*text == '<') fputs("&lt;", stdout);
        else if (*text == '>') fputs("&gt;", stdout);
        else if (*text == '&') fputs("&amp;", stdout);
        else if (*text == '"') fputs("&quot;", stdout);
        else putchar(*text);
}

static const char *number(char buffer[32],
                          double value) /* shortest text that reads back the same */
{
    for (int digits = 1; digits <= 17; digits++) {
        snprintf(buffer, 32, "%.*g", digits, value);
        if (strtod(buffer, NULL) == value) break;
    }
    return buffer;
}

static void print_attribute(const char *name, double value)
{
    char text[32];
    printf(" %s=\"%s\"", name, number(text, value));
}

static void print_exponent(const char *name, int exponent)
{
    if (exponent) printf(" %s=\"%d\"", name, exponent);
}

static int unit_seen_before(size_t row)
{
    for (size_t i = 0; i < row; i++)
        if (strcmp(fmu_model.variables[i].unit, fmu_model.variables[row].unit) == 0) return 1;
    return 0;
}

static const char *display_unit(const char *unit)
{
    return strcmp(unit, "rad") == 0 ? "deg" : strcmp(unit, "rad/s") == 0 ? "deg/s" : NULL;
}

static void print_unit(const char *unit)
{
    Dimension d;
    if (!parse_unit(unit, &d)) fault(unit, "unknown unit");
    printf("    <Unit name=\"%s\">\n      <BaseUnit", unit);
    print_exponent("kg", d.kg);
    print_exponent("m", d.m);
    print_exponent("s", d.s);
    print_exponent("rad", d.rad);
    printf("/>\n");
    if (display_unit(unit))
        printf("      <DisplayUnit name=\"%s\" factor=\"57.29577951308232\"/>\n",
               display_unit(unit));
    printf("    </Unit>\n");
}

static void print_units(void)
{
    printf("  <UnitDefinitions>\n");
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        if (!unit_seen_before(i)) print_unit(fmu_model.variables[i].unit);
    printf("  </UnitDefinitions>\n");
}

#define ROOT_10 3.1622776601683795

/* the power of ten nearest to the largest start value of a row, where that is far from 1 */
static double nominal(const Variable *v, const double *values)
{
    double largest = 0;
    for (size_t k = 0; k < v->size; k++) largest = larger(largest, fabs(values[k]));
    double up = 1, down = 1;
    while (largest > up * ROOT_10) up *= 10;
    while (largest > 0 && largest * down * ROOT_10 < 1) down *= 10;
    return up > 10 || down > 10 ? up / down : 1;
}

static void print_bounds(Rule rule)
{
    if (lowest(rule) > -DBL_MAX) print_attribute("min", lowest(rule));
    if (highest(rule) < DBL_MAX) print_attribute("max", highest(rule));
}

/* what tells a tool that the input may stay undriven (harness/system/interface.py reads it) */
#define OPTIONAL_MARK \
    "<Annotations><Tool name=\"servicing-fmus\"><OptionalInput/></Tool></Annotations>"

static void print_variable(size_t row, size_t element, const void *model)
{
    static const char *const kind[] = {
        "causality=\"parameter\" variability=\"fixed\" initial=\"exact\"",
        "causality=\"input\" variability=\"continuous\"",
        "causality=\"output\" variability=\"continuous\" initial=\"calculated\"",
    };
    char name[NAME_SIZE];
    const Variable *v = &fmu_model.variables[row];
    Scalar s = {v, element};
    const double *values = values_from(model, (Scalar){v, 0});

    printf("    <ScalarVariable name=\"%s\" valueReference=\"%u\" %s description=\"",
           element_name(name, s), (unsigned)(VR_STRIDE * row + element), kind[v->causality]);
    print_text(v->text);
    printf("\">\n      <Real unit=\"%s\"", v->unit);
    if (display_unit(v->unit)) printf(" displayUnit=\"%s\"", display_unit(v->unit));
    print_bounds(v->rule);
    if (nominal(v, values) != 1) print_attribute("nominal", nominal(v, values));
    if (v->causality != OUTPUT_ROW) print_attribute("start", value_of(fmu_model.start, s));
    printf("/>\n");
    if (v->kind == OPTIONAL_ROW) printf("      " OPTIONAL_MARK "\n");
    printf("    </ScalarVariable>\n");
}

static void print_variables(const void *model)
{
    printf("  <ModelVariables>\n");
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; k < fmu_model.variables[i].size; k++) print_variable(i, k, model);
    printf("  </ModelVariables>\n");
}

static void print_unknowns(const char *section, const char *attributes)
{
    unsigned index = 1;
    printf("    <%s>\n", section);
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; k < fmu_model.variables[i].size; k++, index++)
            if (fmu_model.variables[i].causality == OUTPUT_ROW)
                printf("      <Unknown index=\"%u\"%s/>\n", index, attributes);
    printf("    </%s>\n", section);
}

static void print_header(const char *version, const char *date, int sources, char *source[])
{
    char guid[GUID_SIZE];
    printf("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" "
           "modelName=\"%s\" "
           "guid=\"%s\"\n  description=\"",
           fmu_model.name, guid_of(&fmu_model, guid));
    print_text(fmu_model.text);
    printf("\" author=\"servicing-fmus\" version=\"%s\" copyright=\"BSD-2-Clause, see "
           "licenses/license.txt\"\n"
           "  license=\"BSD-2-Clause\" generationTool=\"servicing-fmus %s\" "
           "generationDateAndTime=\"%s\" "
           "variableNamingConvention=\"structured\">\n",
           version, version, date);
    printf("  <CoSimulation modelIdentifier=\"%s\" canHandleVariableCommunicationStepSize=\"%s\" "
           "canGetAndSetFMUstate=\"true\" "
           "canSerializeFMUstate=\"true\" providesDirectionalDerivative=\"true\">\n    "
           "<SourceFiles>\n",
           fmu_model.name, fmu_model.macro_step ? "false" : "true");
    for (int i = 0; i < sources; i++) printf("      <File name=\"%s\"/>\n", source[i]);
    printf("    </SourceFiles>\n  </CoSimulation>\n");
}

static void print_description(const char *version, const char *date, int sources, char *source[],
                              const void *model)
{
    print_header(version, date, sources, source);
    print_units();
    printf(
        "  <LogCategories>\n"
        "    <Category name=\"logStatusError\" description=\"refused calls and failed steps\"/>\n"
        "    <Category name=\"logStatusWarning\" description=\"questionable calls\"/>\n"
        "    <Category name=\"logEvents\" description=\"life cycle of the instance\"/>\n  "
        "</LogCategories>\n");
    printf("  <DefaultExperiment " EXPERIMENT "/>\n");
    print_variables(model);
    printf("  <ModelStructure>\n");
    print_unknowns("Outputs", " dependencies=\"\"");
    print_unknowns("InitialUnknowns", "");
    printf("  </ModelStructure>\n</fmiModelDescription>\n");
}

/* ---- fit to ship? ---- */
static void check_row(size_t row)
{
    const Variable *v = &fmu_model.variables[row];
    if (!*v->text) fault(v->name, "no description");
    if (row > 0 && v->causality < fmu_model.variables[row - 1].causality)
        fault(v->name, "rows must be in the order parameters, inputs, outputs");
    if (v->kind == OPTIONAL_ROW && v->causality != INPUT_ROW)
        fault(v->name, "only an input can be optional");
    if (v->kind == GRID_ROW && (v->causality != PARAMETER_ROW || v->size != 1))
        fault(v->name, "only a parameter of one element can be a grid of times");
    if (v->size == 0 || v->size > VR_STRIDE || v->size % v->columns)
        fault(v->name, "impossible shape");
    for (size_t i = 0; i < row; i++)
        if (strcmp(fmu_model.variables[i].name, v->name) == 0) fault(v->name, "name used twice");
}

static void check_values(const void *model)
{
    char name[NAME_SIZE];
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; k < fmu_model.variables[i].size; k++) {
            Scalar s = {&fmu_model.variables[i], k};
            const char *rule = broken_rule(s.row->rule, value_of(model, s));
            if (rule) fault(element_name(name, s), rule);
        }
}

static void *initialized_model(void)
{
    Problems problems = {{0}, 0, ""};
    void *model = calloc(1, memory_of(&fmu_model));
    if (!model) exit(1);
    memcpy(model, fmu_model.start, fmu_model.size);
    fmu_model.check(model, &problems);
    if (problems.count) fault("start values", problems.text);
    fmu_model.initialize(model, 0);
    return model;
}

int main(int count, char *argument[])
{
    if (count < 4) {
        fprintf(stderr, "usage: describe VERSION DATE SOURCE...\n");
        return 2;
    }
    void *model = initialized_model();
    for (size_t i = 0; i < fmu_model.variable_count; i++) check_row(i);
    check_values(model);
    print_description(argument[1], argument[2], count - 3, argument + 3, model);
    free(model);
    return faults ? 1 : 0;
}
