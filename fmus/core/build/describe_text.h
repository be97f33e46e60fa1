/* describe_text.h - parts of the model descriptions of both versions of FMI: units, numbers,
 * texts. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DESCRIBE_TEXT_H
#define DESCRIBE_TEXT_H

#include "interface.h"

#include <stdlib.h>

#ifndef EXPERIMENT /* default experiment; for a fused system fuse.py defines it */
#define EXPERIMENT "startTime=\"0\" stopTime=\"100\" stepSize=\"0.1\""
#endif

static int faults = 0;

static void report_fault(const char *name, const char *problem)
{
    fprintf(stderr, "%s: %s: %s\n", fmu_model.name, name, problem);
    faults++;
}

/* ---- units: products of kg m s rad N J with exponents ("kg.m2", "1/(N.m)"), or "1" ---- */
typedef struct { int kg, m, s, rad; } Dimension;

static const struct {
    const char *symbol;
    Dimension dimension;
} base_units[] = {
    {"rad", {0, 0, 0, 1}}, {"kg", {1, 0, 0, 0}}, {"m", {0, 1, 0, 0}}, {"s", {0, 0, 1, 0}},
    {"N", {1, 1, -2, 0}},  {"J", {1, 2, -2, 0}}, {"1", {0, 0, 0, 0}},
};

/* reads one factor of a unit, such as "s2", at *text and adds its exponents of kg, m, s and
 * rad, times `sign`, to d; returns 0 if the unit is unknown */
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
            sign = -1; /* the factors that follow are divisors, in brackets if there are several */
        if (*text == '(' && sign < 0) text++;
    }
    return 0;
}

/* ---- printing ---- */
static void print_text(const char *text) /* escaped, as value of an XML attribute */
{
    for (; *text; text++)
        if (*text == '<') fputs("&lt;", stdout);
        else if (*text == '>') fputs("&gt;", stdout);
        else if (*text == '&') fputs("&amp;", stdout);
        else if (*text == '"') fputs("&quot;", stdout);
        else putchar(*text);
}

static const char *number(char buffer[32],
                          double value) /* shortest text that reads back as the same double */
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
    if (!parse_unit(unit, &d)) report_fault(unit, "unknown unit");
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

static void print_units(bool seconds) /* seconds: print the unit s even if no row has it */
{
    printf("  <UnitDefinitions>\n");
    for (size_t i = 0; i < fmu_model.variable_count; i++) {
        if (!unit_seen_before(i)) print_unit(fmu_model.variables[i].unit);
        if (strcmp(fmu_model.variables[i].unit, "s") == 0) seconds = false;
    }
    if (seconds) print_unit("s");
    printf("  </UnitDefinitions>\n");
}

#define ROOT_10 3.1622776601683795

/* nominal value: the power of ten nearest to the largest absolute initial value of a row. Powers
 * 0.1 and 10 are replaced by 1, the default of FMI, so that no attribute is printed */
static double nominal(const Variable *v, const double *values)
{
    double largest = 0;
    for (size_t k = 0; k < v->size; k++) largest = larger(largest, fabs(values[k]));
    double up = 1, down = 1;
    while (largest > up * ROOT_10) up *= 10;
    while (largest > 0 && largest * down * ROOT_10 < 1) down *= 10;
    return up > 10 || down > 10 ? up / down : 1;
}

/* ---- modes: variables whose values 0, 1, .. have names, separated by | in `names` ---- */
static int last_mode(const char *names)
{
    int count = 0;
    for (; *names; names++) count += *names == '|';
    return count;
}

/* prints the description of a row; for a mode with numbers and names: "cause: 0 none, 1 abort" */
static void print_description(const Variable *v)
{
    printf(" description=\"");
    print_text(v->text);
    const char *between = *v->text ? ": " : "";
    int number = 0;
    for (const char *name = v->names; name; number++) {
        const size_t length = strcspn(name, "|");
        if (length) printf("%s%d %.*s", between, number, (int)length, name);
        if (length) between = ", ";
        name = name[length] ? name + length + 1 : NULL;
    }
    putchar('"');
}

static void print_bounds(const Variable *v, double value)
{
    /* a mode that is an input has no bounds: a model takes any other value as the nearest mode, or
     * as no mode */
    const bool is_mode = v->names && v->causality == OUTPUT_ROW;
    const double low = is_mode ? smaller(value, 0) : lowest(v->rule);
    const double high = is_mode ? last_mode(v->names) : highest(v->rule);
    if (low > -DBL_MAX) print_attribute("min", low);
    if (high < DBL_MAX) print_attribute("max", high);
}

/* true if a row is an output, and the model (in a fused system the component of the row) has a
 * parameter sample_period. In the names of both, the part up to the last point of this parameter's
 * name is the same, or there is no point in it. */
static bool is_sampled(const Variable *v)
{
    if (v->causality != OUTPUT_ROW) return false;
    for (size_t i = 0; i < fmu_model.variable_count; i++) {
        const char *name = fmu_model.variables[i].name, *point = strrchr(name, '.');
        const size_t length = point ? (size_t)(point - name) + 1 : 0;
        if (strncmp(name, v->name, length) == 0 && strcmp(name + length, "sample_period") == 0)
            return true;
    }
    return false;
}

static const char *variability(const Variable *v)
{
    if (v->causality == PARAMETER_ROW) return "fixed";
    return is_flag(v->rule) || v->names || is_sampled(v) ? "discrete" : "continuous";
}

/* true if a row has annotations for the harness (harness/system/interface.py): it is an input that
 * may stay unconnected, or its values have names */
static bool is_annotated(const Variable *v) { return v->kind == OPTIONAL_ROW || v->names; }

/* prints the annotations of a row, each an XML element with a name of this project as attribute.
 * begin: names of the element and attribute ("Tool name" in FMI 2.0); end: name of the element */
static void print_annotations(const Variable *v, const char *begin, const char *end)
{
    if (!is_annotated(v)) return;
    printf("      <Annotations>");
    if (v->kind == OPTIONAL_ROW) printf("<%s=\"servicing-fmus\"><OptionalInput/></%s>", begin, end);
    if (v->names) {
        printf("<%s=\"servicing-fmus.modes\"><Modes names=\"", begin);
        print_text(v->names);
        printf("\"/></%s>", end);
    }
    printf("</Annotations>\n");
}

/* data of the build: attributes of the root element and list of sources */
typedef struct {
    const char *version, *date;
    const char *licenses; /* folder of licenses/: "" in FMI 2.0, "documentation/" in 3.0 */
    int sources;
    char **source;
} Build;

static void print_log_categories(void)
{
    printf(
        "  <LogCategories>\n"
        "    <Category name=\"logStatusError\" description=\"rejected calls and failed steps\"/>\n"
        "    <Category name=\"logStatusWarning\" "
        "description=\"alarms of the model and questionable calls\"/>\n"
        "    <Category name=\"logEvents\" description=\"life cycle of the instance\"/>\n  "
        "</LogCategories>\n");
    printf("  <DefaultExperiment " EXPERIMENT "/>\n");
}

/* attributes of the root element after name and guid */
static void print_origin(const Build *b)
{
    printf("\n  description=\"");
    print_text(fmu_model.text);
    printf("\" author=\"servicing-fmus\" version=\"%s\" copyright=\"BSD-2-Clause, see "
           "%slicenses/license.txt\"\n"
           "  license=\"BSD-2-Clause\" generationTool=\"servicing-fmus %s\" "
           "generationDateAndTime=\"%s\" "
           "variableNamingConvention=\"structured\">\n",
           b->version, b->licenses, b->version, b->date);
}

/* unit, bounds and nominal value; the start value is printed separately */
static void print_real_attributes(const Variable *v, const double *values)
{
    printf(" unit=\"%s\"", v->unit);
    if (display_unit(v->unit)) printf(" displayUnit=\"%s\"", display_unit(v->unit));
    print_bounds(v, *values);
    if (nominal(v, values) != 1) print_attribute("nominal", nominal(v, values));
}

#endif
